"""Assembly on one rank: element tensors straight into their places.

The places of all entries are found once; an assembly is then one loop over the cells in C
(`element_loop.c`), without PETSc's search for every entry of a matrix and without a step of
Python in between.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

import cffi
import dolfinx
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

SOURCE = Path(__file__).parent / "element_loop.c"
CELL_INTEGRAL = 0  # of FFCx's enumeration of integral types
COMPILER_FLAGS = ("-O3", "-shared", "-fPIC")


class ElementLoop:
    """The loop over the cells for one form or expression.

    Parameters
    ----------
    kernel : cffi function
        Element tensor of one cell, as FFCx generated it; its one coefficient is the displacement.
    constants : array
        Of the form, as dolfinx packs them.
    u : dolfinx.fem.Function
        The displacement: P1 or Q1 vectors on a mesh that lives on one rank.
    places : array of int32, (n_cells, n_entries)
        Where in `values` each entry of each element tensor is added.
    size : int
        Length of `values`.

    Attributes
    ----------
    values : array, (size,)
        What is assembled; it keeps its memory.
    """

    def __init__(
        self,
        kernel: Any,
        constants: NDArray[np.float64],
        u: Any,
        places: NDArray[np.int32],
        size: int,
    ) -> None:
        geometry = u.function_space.mesh.geometry
        dofs = cell_dofs(u.function_space)
        vertices = geometry.dofmap.array.reshape(len(dofs), -1).astype(np.int32)
        work = np.empty(places.shape[1] + dofs.shape[1] + 3 * vertices.shape[1])
        points = np.ascontiguousarray(geometry.x, dtype=np.float64)
        self.values = np.zeros(size)
        displacement = u.x.array
        self._kept = places, dofs, vertices, points, displacement, constants, work, self.values
        self._function = _load_loop()
        self._arguments = (
            int(cffi.FFI().cast("uintptr_t", kernel)),
            len(dofs),
            places.shape[1],
            dofs.shape[1],
            vertices.shape[1],
            *(array.ctypes.data for array in self._kept),
        )

    def run(self) -> NDArray[np.float64]:
        """Replace the values by those at the current displacement, and return them."""
        self.values.fill(0.0)
        self._function(*self._arguments)
        return self.values


class SerialAssembly:
    """Tangent and internal forces of a problem on one rank.

    Parameters
    ----------
    internal, tangent : dolfinx forms
        f_int and ∂f_int/∂u.
    u : dolfinx.fem.Function
        The displacement.
    clamped : array of int
        Degrees of freedom whose rows and columns of the tangent are those of the identity.

    Attributes
    ----------
    matrix : PETSc.Mat
        Sequential; its values are changed in place by `assemble_tangent`.
    """

    def __init__(self, internal: Any, tangent: Any, u: Any, clamped: NDArray[np.intp]) -> None:
        space = u.function_space
        dofs = cell_dofs(space)
        size = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        dropped = np.zeros(size, dtype=bool)
        dropped[clamped] = True
        indptr, indices = _sparsity(dofs, size)
        places = _places(dofs, indptr, indices, dropped)
        self._forces = ElementLoop(_kernel(internal), _constants(internal), u, dofs, size)
        self._tangent = ElementLoop(
            _kernel(tangent), _constants(tangent), u, places, len(indices) + 1
        )  # the last value takes what is dropped
        self._diagonal = _diagonal(indptr, indices)[dropped]
        self.matrix = PETSc.Mat().createAIJWithArrays(
            (size, size), (indptr, indices, self._tangent.values[:-1]), comm=PETSc.COMM_SELF
        )
        self.matrix.setBlockSize(space.dofmap.index_map_bs)

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current displacement, the identity in the clamped rows."""
        self._tangent.run()[self._diagonal] = 1.0
        self.matrix.assemble()

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the internal forces at the current displacement, in N."""
        b.array_w[:] = self._forces.run()


def cell_dofs(space: Any) -> NDArray[np.int32]:
    """Degrees of freedom of every cell, component by component: (n_cells, corners · d)."""
    d = space.dofmap.index_map_bs
    blocks = space.dofmap.list.array.reshape(-1, space.dofmap.dof_layout.num_dofs)
    dofs = (blocks[:, :, None] * d + np.arange(d)).reshape(len(blocks), -1)
    return np.ascontiguousarray(dofs, dtype=np.int32)


def _sparsity(dofs: NDArray[np.int32], size: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Row pointers and column indices of the matrix that couples the dofs of every cell."""
    per_cell = dofs.shape[1]
    rows = np.repeat(dofs, per_cell, axis=1).ravel().astype(np.int64)
    columns = np.tile(dofs, (1, per_cell)).ravel()
    keys = np.unique(rows * size + columns)
    indptr = np.searchsorted(keys, np.arange(size + 1, dtype=np.int64) * size)
    return indptr.astype(PETSc.IntType), (keys % size).astype(PETSc.IntType)


def _places(
    dofs: NDArray[np.int32],
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    dropped: NDArray[np.bool_],
) -> NDArray[np.int32]:
    """Where each entry of each element matrix belongs; behind the last value if it is dropped."""
    size = len(dropped)
    row_of = np.repeat(np.arange(size, dtype=np.int64), np.diff(indptr))
    keys = row_of * size + indices
    rows, columns = dofs[:, :, None].astype(np.int64), dofs[:, None, :]
    places = np.searchsorted(keys, rows * size + columns)
    places[dropped[rows] | dropped[columns]] = len(indices)
    return np.ascontiguousarray(places.reshape(len(dofs), -1), dtype=np.int32)


def _diagonal(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> NDArray[np.intp]:
    """Place of the diagonal entry of every row."""
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return np.flatnonzero(rows == indices)


def _kernel(form: Any) -> Any:
    """The function that FFCx generated for the cell integral of a form."""
    return form.ufcx_form.integrals(CELL_INTEGRAL)[0].tabulate_tensor_float64


def _constants(form: Any) -> NDArray[np.float64]:
    return np.asarray(dolfinx.cpp.fem.pack_constants(form))


def _load_loop() -> Any:
    """Compile `element_loop.c`, or take what an earlier start compiled, and load its function."""
    source = SOURCE.read_bytes()
    key = hashlib.sha256(source + " ".join(COMPILER_FLAGS).encode()).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "datagen"
    library = cache / f"element_loop-{key}{sysconfig.get_config_var('SHLIB_SUFFIX')}"
    if not library.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as folder:
            built = Path(folder) / library.name
            subprocess.run(["cc", *COMPILER_FLAGS, str(SOURCE), "-o", str(built)], check=True)
            built.replace(library)
    function = ctypes.CDLL(str(library)).add_element_tensors
    pointer = ctypes.c_void_p
    function.argtypes = [pointer, *(ctypes.c_int,) * 4, *(pointer,) * 8]
    function.restype = None
    return function
