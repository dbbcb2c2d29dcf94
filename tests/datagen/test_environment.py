"""The environment: Debian's own NumPy and h5py, which dolfinx and PETSc are built beside."""

from __future__ import annotations

import h5py
import numpy as np


def test_debians_libraries_are_in_place() -> None:
    """pip's h5py brings an HDF5 of its own, which clashes with PETSc's in one process."""
    assert np.__version__.startswith("1.24")
    for module in (np, h5py):
        assert module.__file__ is not None
        assert module.__file__.startswith("/usr/lib/python3")
