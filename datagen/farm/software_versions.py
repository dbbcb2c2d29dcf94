"""Versions of the software that made a dataset."""

from __future__ import annotations

import platform

from datagen import __version__


def software_versions() -> dict[str, str]:
    """Versions by name of software, as the manifest stores them."""
    import dolfinx
    import gmsh
    import h5py
    import numpy as np
    from petsc4py import PETSc

    return {
        "datagen": __version__,
        "python": platform.python_version(),
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
        "gmsh": gmsh.GMSH_API_VERSION,
        "h5py": h5py.__version__,
        "numpy": np.__version__,
    }
