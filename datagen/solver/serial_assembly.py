r"""Assembly on one rank: element tensors are added directly into vector and matrix.

The global vector and matrix are sums over the cells c of the element vectors and matrices,

.. math:: f_{int} = \sum_c A_c^T f_c, \qquad K = \sum_c A_c^T K_c A_c,

where A_c picks the degrees of freedom of cell c. The place in memory of every entry of every
element tensor is determined once; each assembly is then one loop over the cells in C
(`datagen.solver.element_loop`), without PETSc's search for the place of each matrix entry.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.solver.element_loop import FormLoop, cell_dofs


class SerialAssembly:
    """Tangent and internal forces of a problem whose mesh lives on one rank.

    Parameters
    ----------
    internal, tangent : dolfinx forms
        f_int(u) in N and K(u) = ∂f_int/∂u in N/m.
    u : dolfinx.fem.Function
        Displacement in m.
    clamped : array of int
        Clamped degrees of freedom: the tangent has the rows and columns of the identity there.
    moved : array of int
        Degrees of freedom with a prescribed displacement: the tangent has the rows of the identity
        there, and keeps their columns, so that a Newton step moves the rest of the body with them.
    parts : array of int, (n_cells,) or None
        Part of the mesh that each cell belongs to, if the forms have several.

    Attributes
    ----------
    matrix : PETSc.Mat
        Sequential, (n_nodes · d, n_nodes · d), in compressed rows; `assemble_tangent` changes its
        values in place.
    """

    def __init__(
        self,
        internal: Any,
        tangent: Any,
        u: Any,
        clamped: NDArray[np.intp],
        moved: NDArray[np.intp] | None = None,
        parts: NDArray[np.int64] | None = None,
    ) -> None:
        space = u.function_space
        dofs = cell_dofs(space)
        size = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        columns = np.zeros(size, dtype=bool)
        columns[clamped] = True
        rows = columns.copy()
        rows[[] if moved is None else moved] = True
        indptr, indices = _sparsity(dofs, size)
        places = _places(dofs, indptr, indices, rows, columns)
        self._forces = FormLoop(internal, u, dofs, size, parts)
        self._tangent = FormLoop(tangent, u, places, len(indices) + 1, parts)
        # The last value of the tangent, outside the matrix, takes the dropped entries.
        self._diagonal = _diagonal(indptr, indices)[rows]
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
    dropped_rows: NDArray[np.bool_],
    dropped_columns: NDArray[np.bool_],
) -> NDArray[np.int32]:
    """Index of each element matrix entry among the matrix values; past the end if dropped."""
    size = len(dropped_rows)
    row_of = np.repeat(np.arange(size, dtype=np.int64), np.diff(indptr))
    keys = row_of * size + indices
    rows, columns = dofs[:, :, None].astype(np.int64), dofs[:, None, :]
    places = np.searchsorted(keys, rows * size + columns)
    places[dropped_rows[rows] | dropped_columns[columns]] = len(indices)
    return np.ascontiguousarray(places.reshape(len(dofs), -1), dtype=np.int32)


def _diagonal(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> NDArray[np.intp]:
    """Index of the diagonal entry of every row among the matrix values."""
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return np.flatnonzero(rows == indices)
