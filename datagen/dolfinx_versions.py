"""dolfinx 0.5 to 0.11 under names and arguments of 0.11: the only place that asks for a version.

Each entry says from which version on dolfinx itself is so, and does the same with older ones. The
changes are those of the sources of dolfinx and FFCx at their releases. Once 0.5 (Debian 12) and 0.9
(Debian 13) are history, an entry can be replaced by the call that it makes for the newest version.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import basix
import dolfinx
import dolfinx.jit
import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.compiled_cache import remove_stale_locks, writable
from shared_schema.common.errors import WorkError, first_line

P = ParamSpec("P")
R = TypeVar("R")
__all__ = ["NewtonSolverNonlinearProblem", "functionspace"]

VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
# Options for the compiler of the kernels. 0.7: FFCx writes each term of a sum as a statement of its
# own (81 for a pair of shape functions in space, 27 before); with these the compiler adds up first,
# which takes 0.6 of the time. Unlike -ffast-math, they let NaN stay NaN. A process waits "timeout"
# seconds for another one that compiles the same kernel; the default, 10, is short.
COMPILER_OPTIONS: dict[str, Any] = {
    "timeout": 120,
    "cffi_extra_compile_args": ["-O3"]
    + ["-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math"] * (VERSION >= (0, 7)),
}


def _no_news(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING


@contextmanager
def _quiet_compiler() -> Iterator[None]:
    """Keep quiet about every call of the C compiler, which setuptools logs by the root logger."""
    root = logging.getLogger()
    root.addFilter(_no_news)
    logging.getLogger("ffcx").setLevel(logging.WARNING)
    try:
        yield
    finally:
        root.removeFilter(_no_news)


def _cache() -> Path:
    """Folder of compiled kernels (0.6; before, the options were parameters)."""
    of = dolfinx.jit.get_options if VERSION >= (0, 6) else dolfinx.jit.get_parameters
    return Path(of()["cache_dir"])


@cache
def _clean() -> None:
    """Make the folder of compiled kernels, and remove what earlier processes left, once."""
    folder = writable(_cache())
    if MPI.COMM_WORLD.rank == 0:
        remove_stale_locks(folder, COMPILER_OPTIONS["timeout"])


def _compiling(make: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function that compiles: it does not wait for a process that was killed.

    Without MPI, what such a process left shortly before is removed after the time-out; otherwise
    the error names the file to delete.
    """

    @wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> R:
        _clean()
        with _quiet_compiler():
            try:
                return make(*args, **kwargs)
            except TimeoutError as error:
                is_alone = MPI.COMM_WORLD.size == 1
                if is_alone and remove_stale_locks(_cache(), COMPILER_OPTIONS["timeout"]):
                    return made(*args, **kwargs)
                text = f"another process compiles, or was killed: {first_line(error)}"
                raise WorkError(text) from None

    return made


@_compiling
def create_mesh(
    comm: MPI.Comm, cells: NDArray[np.int64], cell: str, x: NDArray[np.float64]
) -> dolfinx.mesh.Mesh:
    """Distribute a mesh of linear elements (collective).

    - 0.7: elements are basix's; before they were UFL's, with a geometric dimension.
    - 0.10: the element stands before the coordinates, and need not be wrapped by ``ufl.Mesh``.

    Parameters
    ----------
    comm : mpi4py communicator
    cells : array of int, (n_cells, n_corners)
        Nodes of the cells that this rank hands in, in dolfinx's order.
    cell : str
        Name of their type, such as ``quadrilateral``.
    x : array, (n_nodes, d)
        Nodes that this rank hands in, in m.
    """
    d = x.shape[1]
    if VERSION >= (0, 7):
        element = basix.ufl.element("Lagrange", cell, 1, shape=(d,))
    else:
        element = ufl.VectorElement("Lagrange", ufl.Cell(cell, geometric_dimension=d), 1)
    if VERSION >= (0, 10):
        return dolfinx.mesh.create_mesh(comm, cells, element, x)
    return dolfinx.mesh.create_mesh(comm, cells, x, ufl.Mesh(element))


@_compiling
def functionspace(domain: dolfinx.mesh.Mesh, element: tuple[str, int, tuple[int]]) -> Any:
    """Space of vectors, by family, degree and shape (0.7; before ``VectorFunctionSpace``)."""
    if VERSION >= (0, 7):
        return dolfinx.fem.functionspace(domain, element)
    family, degree, (d,) = element
    return dolfinx.fem.VectorFunctionSpace(domain, (family, degree), dim=d)


@_compiling
def mixed_space(domain: dolfinx.mesh.Mesh, degree: int, d: int, scalar: tuple[str, int]) -> Any:
    """Space of continuous vectors and two scalars (0.7: elements are basix's, before UFL's).

    Parameters
    ----------
    domain : dolfinx.mesh.Mesh
    degree : int
        Of the vectors.
    d : int
        Number of their components.
    scalar : (str, int)
        Family and degree of both scalars.
    """
    family, order = scalar
    cell = domain.topology.cell_type.name
    if VERSION >= (0, 7):
        vector = basix.ufl.element("Lagrange", cell, degree, shape=(d,))
        part = basix.ufl.element(family, cell, order)
        return dolfinx.fem.functionspace(domain, basix.ufl.mixed_element([vector, part, part]))
    shape = domain.ufl_cell()
    part = ufl.FiniteElement(family, shape, order)
    vector = ufl.VectorElement("Lagrange", shape, degree, dim=d)
    return dolfinx.fem.FunctionSpace(domain, ufl.MixedElement([vector, part, part]))


def geometry_nodes(domain: dolfinx.mesh.Mesh) -> NDArray[np.int32]:
    """Geometry nodes of every cell, (n_cells, n_corners): ``geometry.dofmaps[0]`` (0.11).

    It was ``geometry.dofmap`` before, and before 0.7 that was no array.
    """
    geometry = domain.geometry
    return _as_array(geometry.dofmaps[0] if VERSION >= (0, 11) else geometry.dofmap)


def cell_blocks(space: Any) -> NDArray[np.int32]:
    """Blocks of degrees of freedom of every cell, (n_cells, n_corners) (0.7; before no array)."""
    return _as_array(space.dofmap.list)


def _as_array(adjacency: Any) -> NDArray[np.int32]:
    if VERSION >= (0, 7):
        return np.asarray(adjacency, dtype=np.int32)
    return np.asarray(adjacency.array, dtype=np.int32).reshape(adjacency.num_nodes, -1)


@_compiling
def form(expression: Any, jit_options: dict[str, Any]) -> Any:
    """Compile a form (0.6; before, the options were ``jit_params``)."""
    return dolfinx.fem.form(expression, **_named(jit_options))


@_compiling
def point_expression(
    expression: Any, points: NDArray[np.float64], jit_options: dict[str, Any]
) -> Any:
    """Compile an expression for points of the cells (0.6; before, options were ``jit_params``)."""
    return dolfinx.fem.Expression(expression, points, **_named(jit_options))


def _named(jit_options: dict[str, Any]) -> dict[str, Any]:
    return {"jit_options" if VERSION >= (0, 6) else "jit_params": jit_options}


def evaluate(
    expression: Any, domain: dolfinx.mesh.Mesh, cells: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Values of an expression in given cells (0.7; before, it knew its mesh)."""
    if VERSION >= (0, 7):
        return np.asarray(expression.eval(domain, cells))
    return np.asarray(expression.eval(cells))


def cell_kernels(compiled: Any) -> dict[int, Any]:
    """Functions generated by FFCx for the cell integrals of a form, by their part of the mesh.

    A form over the whole mesh has one, number -1. 0.7: integrals are a list, those over cells
    first; before, functions gave them by their type.
    """
    ufcx = compiled.ufcx_form
    if VERSION >= (0, 7):
        count, integrals = ufcx.form_integral_offsets[1], ufcx.form_integrals
        ids = ufcx.form_integral_ids
    else:
        count, integrals, ids = ufcx.num_integrals(0), ufcx.integrals(0), ufcx.integral_ids(0)
    return {int(ids[i]): integrals[i].tabulate_tensor_float64 for i in range(count)}


def pack_constants(compiled: Any) -> NDArray[np.float64]:
    """Values of the constants of a form, as its kernels read them (0.10).

    0.7: the C++ function, used with older versions, takes the form's C++ object.
    """
    if VERSION >= (0, 10):
        return np.asarray(dolfinx.fem.pack_constants(compiled))
    cpp = compiled._cpp_object if VERSION >= (0, 7) else compiled
    return np.asarray(dolfinx.cpp.fem.pack_constants(cpp))


# Macros for C code that calls such a function (0.10: it has a last argument, data of the user).
KERNEL_MACROS = ("-DKERNEL_HAS_CUSTOM_DATA",) if VERSION >= (0, 10) else ()


def create_vector(space: Any) -> Any:
    """PETSc vector of a space, with ghosts (0.10; before, it was made for an index map)."""
    if VERSION >= (0, 10):
        return fem_petsc.create_vector(space)
    return dolfinx.la.create_petsc_vector(space.dofmap.index_map, space.dofmap.index_map_bs)


# Base class of problems for dolfinx's own Newton solver (0.10: the old name is that of another).
NewtonSolverNonlinearProblem: Any = (
    fem_petsc.NewtonSolverNonlinearProblem if VERSION >= (0, 10) else fem_petsc.NonlinearProblem
)
