"""Versions of the software that made a dataset."""

from __future__ import annotations

import platform

from datagen import __version__


def software_versions(solved: bool = True) -> dict[str, str]:
    """Versions by name of software, as the manifest stores them; solvers only if they were used."""
    import gmsh
    import h5py
    import numpy as np

    return {
        "datagen": __version__,
        "python": platform.python_version(),
        **(_solvers() if solved else {}),
        "gmsh": gmsh.GMSH_API_VERSION,
        "h5py": h5py.__version__,
        "numpy": np.__version__,
    }


def _solvers() -> dict[str, str]:
    import dolfinx
    from petsc4py import PETSc

    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
    }
