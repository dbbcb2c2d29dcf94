"""Assembly of the tangent on one rank: element matrices straight into their places.

The places of all entries are found once; an assembly is then one loop over the cells in C
(`element_loop.c`), without PETSc's search for every entry.
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
CELL_INTEGRAL = 0  # of the enumeration ufcx_integral_type
COMPILER_FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")


class TangentAssembler:
    """The tangent ∂f_int/∂u of a problem whose mesh lives on one rank.

    Parameters
    ----------
    form : dolfinx form
        Bilinear; its one coefficient is the displacement.
    u : dolfinx.fem.Function
        The displacement; P1 or Q1 vectors.
    clamped_blocks : array of int
        Blocks of degrees of freedom whose rows and columns are those of the identity.

    Attributes
    ----------
    matrix : PETSc.Mat
        Sequential; its values are changed in place by `assemble`.
    """

    def __init__(self, form: Any, u: Any, clamped_blocks: NDArray[np.int32]) -> None:
        space = u.function_space
        d = space.dofmap.index_map_bs
        blocks = space.dofmap.list.array.reshape(-1, space.dofmap.dof_layout.num_dofs)
        dofs = (blocks[:, :, None] * d + np.arange(d, dtype=np.int32)).reshape(len(blocks), -1)
        size = space.dofmap.index_map.size_local * d
        clamped = np.zeros(size, dtype=bool)
        clamped[(clamped_blocks[:, None] * d + np.arange(d)).ravel()] = True

        geometry = space.mesh.geometry
        self._u = u
        self._dofs = np.ascontiguousarray(dofs, dtype=np.int32)
        self._vertices = geometry.dofmap.array.reshape(len(dofs), -1).astype(np.int32)
        self._points = np.ascontiguousarray(geometry.x, dtype=np.float64)
        self._constants = dolfinx.cpp.fem.pack_constants(form)
        self._kernel = _kernel_address(form)
        self._loop = _load_loop()
        per_cell = dofs.shape[1]
        self._work = np.empty(per_cell**2 + per_cell + 3 * self._vertices.shape[1])

        indptr, indices = _sparsity(self._dofs, size)
        self._places = _places(self._dofs, indptr, indices, clamped)
        self._diagonal = _diagonal(indptr, indices)[clamped]
        self._values = np.zeros(len(indices) + 1)
        self.matrix = PETSc.Mat().createAIJWithArrays(
            (size, size), (indptr, indices, self._values[:-1]), comm=PETSc.COMM_SELF
        )
        self.matrix.setBlockSize(d)

    def assemble(self) -> PETSc.Mat:
        """Assemble at the current displacement, with the identity in the clamped rows."""
        self._values[:] = 0.0
        self._loop(
            self._kernel,
            len(self._dofs),
            self._dofs.shape[1],
            self._vertices.shape[1],
            *(
                array.ctypes.data_as(ctypes.c_void_p)
                for array in (
                    self._dofs,
                    self._vertices,
                    self._points,
                    self._u.x.array,
                    self._constants,
                    self._places,
                    self._work,
                    self._values,
                )
            ),
        )
        self._values[self._diagonal] = 1.0
        self.matrix.assemble()
        return self.matrix


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
    clamped: NDArray[np.bool_],
) -> NDArray[np.int32]:
    """Where each entry of each element matrix belongs; behind the last value if it is dropped."""
    size = len(clamped)
    row_of = np.repeat(np.arange(size, dtype=np.int64), np.diff(indptr))
    keys = row_of * size + indices
    rows, columns = dofs[:, :, None].astype(np.int64), dofs[:, None, :]
    places = np.searchsorted(keys, rows * size + columns)
    places[clamped[rows] | clamped[columns]] = len(indices)
    return np.ascontiguousarray(places, dtype=np.int32)


def _diagonal(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> NDArray[np.intp]:
    """Place of the diagonal entry of every row."""
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return np.flatnonzero(rows == indices)


def _kernel_address(form: Any) -> int:
    """Address of the function that FFCx generated for the cell integral of a form."""
    cell_integral = form.ufcx_form.integrals(CELL_INTEGRAL)[0]
    return int(cffi.FFI().cast("uintptr_t", cell_integral.tabulate_tensor_float64))


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
    function = ctypes.CDLL(str(library)).add_element_matrices
    pointer = ctypes.c_void_p
    function.argtypes = [pointer, *(ctypes.c_int,) * 3, *(pointer,) * 8]
    function.restype = None
    return function
