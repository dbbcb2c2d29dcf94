"""The environment has Debian's NumPy and h5py, which match its dolfinx and PETSc."""

from __future__ import annotations

import h5py
import numpy as np


def test_debians_libraries_are_in_place() -> None:
    """The h5py of pip brings its own HDF5, which conflicts with PETSc's in one process."""
    for module in (np, h5py):
        assert module.__file__ is not None
        assert module.__file__.startswith("/usr/lib/python3")
