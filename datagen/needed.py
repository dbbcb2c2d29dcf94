"""What pip does not install, named in one line where it is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from shared_schema.common.errors import WorkError

SOLVERS = ("basix", "dolfinx", "ffcx", "mpi4py", "petsc4py", "ufl")
DOLFINX = (
    "expected `make setup` on Debian, the package fenics-dolfinx of conda-forge, or the container; "
    "`surrogate sample` and `surrogate predict --correct` find equilibria without it"
)
IMAGES = "expected: pip install 'solid-datagen[images]'"
GMSH = "expected: pip install 'solid-datagen[mesh]', and on Linux libGL, libGLU, libXft and libgomp"


@contextmanager
def solvers_named(what: str) -> Iterator[None]:
    """Raise WorkError, which says how to get them, if the solvers are not there for something."""
    try:
        yield
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] not in SOLVERS:
            raise
        raise WorkError(f"{what} needs dolfinx, which is not installed; {DOLFINX}") from None
