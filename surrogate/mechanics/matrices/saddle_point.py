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
by the error of a solution. θ and p have lengths as units, as in `datagen.solver.forms.weak_form`.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array
from torch import Tensor

from surrogate.mechanics.matrices.sparse_matrix import SparseLayout, of_least_degree


class SaddlePointLayout(SparseLayout):
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
        numbers = np.concatenate([displacements, of_nodes, of_nodes + nodes], axis=1)
        units = np.ones(numbers.shape[1])
        units[-2 * corners :] = 1 / cell_size
        units[-corners:] *= modulus
        self._units = torch.from_numpy(np.outer(units, units))
        unknowns = np.full((points, d + 2), -1)
        unknowns[:, :d] = np.where(held, -1, np.arange(points * d).reshape(-1, d))
        unknowns[:nodes, d] = points * d + np.arange(nodes)
        unknowns[:nodes, d + 1] = unknowns[:nodes, d] + nodes
        order = unknowns[of_least_degree(cells, points)].ravel()
        size = points * d + 2 * nodes
        super().__init__(numbers, order[order >= 0], size, points * d, d, negative=nodes)

    def assembled(self, cell_matrices: Tensor) -> list[csc_array]:
        """Add cell matrices (N, n_cells, m, m) into N matrices, in units that are lengths."""
        return super().assembled(cell_matrices * self._units)
