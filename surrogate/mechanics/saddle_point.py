r"""Sparse tangents of elements whose dilations θ and pressures p are found with the displacement.

.. math::
    \begin{pmatrix} Π_{uu} & Π_{uθ} & B^T \\ Π_{θu} & Π_{θθ} & -M \\ B & -M & 0 \end{pmatrix}
    \begin{pmatrix} x \\ y \\ z \end{pmatrix} = \begin{pmatrix} f \\ 0 \\ 0 \end{pmatrix}

(`surrogate.mechanics.solids.taylor_hood`) has the solution :math:`x = K^{-1} f` with the dense
tangent :math:`K = ∂^2 E / ∂u^2`, which is never formed. The lower right block has one negative
eigenvalue for each pressure, whatever the state. By Sylvester's law of inertia, K is positive
definite exactly if the whole matrix has no more (Haynsworth 1968, *Linear Algebra Appl.* 1, 73).
These are counted as the negative pivots of :math:`L D L^T`, by SuperLU without row exchanges.

The order of the points, by least degree, limits the fill; dilation and pressure of a node follow
its displacements, so that no pivot is zero from the beginning. Pivots that are too small are told
by the error of a solution. θ and p have lengths as units, as in `datagen.solver.weak_form`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags
from scipy.sparse.linalg import splu
from torch import Tensor

from surrogate.mechanics.cell_matrices import sum_of_cells

Array = NDArray[np.float64]
Facets = tuple[NDArray[np.int64], Array]  # of one surface, and their matrices
IN_PLACE = {"diag_pivot_thresh": 0.0, "permc_spec": "NATURAL", "options": {"SymmetricMode": True}}
ACCURATE = 1e-8  # residual of a solution, relative to the right-hand side


class SaddlePointLayout:
    """Places of the unknowns of a body in its sparse tangents.

    Parameters
    ----------
    cells : array of int, (n_cells, n_points)
        All points of every cell, the corners first; nodes have the smallest numbers.
    held : array of bool, (n_points, d)
        Components of the displacement that are no unknowns.
    corners : int
        Number of corners of a cell.
    cell_size, modulus : float
        Units: θ = 1 + t / h, p = q · modulus / h with t and q in m; in m and Pa.

    Attributes
    ----------
    dofs : array of int, (n,)
        Free degrees of freedom of the displacement, point · d + component.
    width : int
        Mean number of entries of a row.
    """

    def __init__(
        self,
        cells: NDArray[np.int64],
        held: NDArray[np.bool_],
        corners: int,
        cell_size: float,
        modulus: float,
    ) -> None:
        points, d = held.shape
        nodes = int(cells[:, :corners].max()) + 1
        of_nodes = points * d + cells[:, :corners]
        displacements = (cells[:, :, None] * d + np.arange(d)).reshape(len(cells), -1)
        self._cells = np.concatenate([displacements, of_nodes, of_nodes + nodes], axis=1)
        self._size, self._pressures = points * d + 2 * nodes, nodes
        self._dimension = d
        self._units = np.ones(self._cells.shape[1])
        self._units[-2 * corners :] = 1 / cell_size
        self._units[-corners:] *= modulus
        unknowns = np.full((points, d + 2), -1)
        unknowns[:, :d] = np.where(held, -1, np.arange(points * d).reshape(-1, d))
        unknowns[:nodes, d] = points * d + np.arange(nodes)
        unknowns[:nodes, d + 1] = unknowns[:nodes, d] + nodes
        ordered = unknowns[_of_least_degree(cells, points)].ravel()
        self._order = ordered[ordered >= 0]
        self._places = np.flatnonzero(self._order < points * d)  # of displacements
        self.dofs = self._order[self._places]
        self.width = self._cells.shape[1] * 2

    def assembled(self, cell_matrices: Tensor) -> list[csc_array]:
        """Add cell matrices (N, n_cells, m, m) into N matrices."""
        scaled = cell_matrices.numpy() * self._units * self._units[:, None]
        return [self._sum(each, self._cells) for each in scaled]

    def factor(self, matrix: csc_array) -> SaddlePointFactor | None:
        """Factorise a matrix; None unless K is positive definite."""
        try:
            lu = splu(matrix, **IN_PLACE)
        except RuntimeError:  # exactly singular
            return None
        if np.any(lu.perm_r != lu.perm_c) or (lu.U.diagonal() < 0).sum() != self._pressures:
            return None
        factor = SaddlePointFactor(lu, matrix, self._places)
        return factor if factor.is_accurate() else None

    def diagonal(self, matrix: csc_array) -> Array:
        """Diagonal at `dofs`."""
        return np.asarray(matrix.diagonal())[self._places]

    def on_springs(self, matrix: csc_array, springs: Array) -> csc_array:
        """The matrix with more stiffness on the diagonal, (n,), at `dofs`."""
        diagonal = np.zeros(len(self._order))
        diagonal[self._places] = springs
        return csc_array(matrix + csc_array(diags(diagonal)))

    def under_pressure(
        self, matrix: csc_array, surfaces: Iterable[Facets]
    ) -> tuple[SaddlePointFactor | None, bool]:
        """Factorise a matrix with those of facets; say whether its symmetric part is definite."""
        d = self._dimension
        symmetric, full = matrix, matrix
        for facets, blocks in surfaces:
            numbers = (facets[:, :, None] * d + np.arange(d)).reshape(len(facets), -1)
            full = full + self._sum(blocks, numbers)
            symmetric = symmetric + self._sum((blocks + blocks.transpose(0, 2, 1)) / 2, numbers)
        stable = self.factor(csc_array(symmetric)) is not None
        try:
            lu = splu(csc_array(full))
        except RuntimeError:
            return None, stable
        return SaddlePointFactor(lu, csc_array(full), self._places), stable

    def _sum(self, matrices: Array, cells: NDArray[np.int64]) -> csc_array:
        total = sum_of_cells(matrices, cells, self._size)
        return csc_array(total[self._order][:, self._order])


class SaddlePointFactor:
    """Factors of a matrix of a `SaddlePointLayout`.

    Parameters
    ----------
    lu : scipy.sparse.linalg.SuperLU
    matrix : csc_array
    places : array of int, (n,)
        Rows of the displacements.
    """

    def __init__(self, lu: Any, matrix: csc_array, places: NDArray[np.int64]) -> None:
        self._lu, self._matrix, self._places = lu, matrix, places

    def solve(self, right: Array) -> Array:
        """K⁻¹ f, once refined: (n,) or (n, m) → same."""
        return self._whole(right)[0][self._places]

    def is_accurate(self) -> bool:
        """Whether the solution for random forces solves the equations."""
        force = np.random.default_rng(0).standard_normal(len(self._places))
        rest = self._whole(force)[1]
        return bool(np.linalg.norm(rest) <= ACCURATE * np.linalg.norm(force))

    def _whole(self, right: Array) -> tuple[Array, Array]:
        """All unknowns, and what they leave of the right-hand side."""
        whole = np.zeros((self._matrix.shape[0], *right.shape[1:]))
        whole[self._places] = right
        found = self._lu.solve(whole)
        found += self._lu.solve(whole - self._matrix @ found)
        return found, whole - self._matrix @ found


def _of_least_degree(cells: NDArray[np.int64], points: int) -> NDArray[np.int64]:
    """Order of the points that leaves few entries in factors of their graph."""
    size = cells.shape[1]
    graph = sum_of_cells(np.ones((len(cells), size, size)), cells, points)
    graph = graph + csc_array(diags(np.full(points, float(graph.sum()))))  # definite
    lu = splu(csc_array(graph), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(np.argsort(lu.perm_c))
