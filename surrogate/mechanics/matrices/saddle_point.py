r"""Sparse tangents of elements whose dilations θ and pressures p are found with the displacement.

.. math::
    \begin{pmatrix} Π_{uu} & Π_{uθ} & B^T \\ Π_{θu} & Π_{θθ} & -M \\ B & -M & 0 \end{pmatrix}
    \begin{pmatrix} x \\ y \\ z \end{pmatrix} = \begin{pmatrix} f \\ 0 \\ 0 \end{pmatrix}

(`surrogate.mechanics.solids.mixed_elements`) has the solution :math:`x = K^{-1} f` with the dense
tangent :math:`K = ∂^2 E / ∂u^2`, which is never formed. The lower right block has one negative
eigenvalue for each pressure, whatever the state. By Sylvester's law of inertia, K is positive
definite exactly if the whole matrix has no more (Haynsworth 1968, *Linear Algebra Appl.* 1, 73).
These are counted as the negative pivots of :math:`L D L^T`, by SuperLU without row exchanges.

The order of the points, by least degree, limits the fill; dilation and pressure of a node follow
its displacements, so that no pivot is zero from the beginning. Pivots that are too small are told
by the error of a solution. θ and p have lengths as units, as in `datagen.solver.weak_form`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.matrices.factors import of_least_degree
from surrogate.mechanics.matrices.layout import Layout, unknowns_of


def saddle_point_layout(
    cells: NDArray[np.int64],
    held: NDArray[np.bool_],
    corners: int,
    cell_size: float,
    modulus: float,
    beside: Sequence[NDArray[np.int64]] = (),
) -> Layout:
    """Lay out the unknowns of a body in its sparse tangents.

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
    beside : sequence of array of int, (n, k)
        Points of other matrices that are added to K.
    """
    points, d = held.shape
    nodes = int(cells[:, :corners].max()) + 1
    of_nodes = points * d + cells[:, :corners]
    displacements = unknowns_of(cells, d)
    numbers = np.concatenate([displacements, of_nodes, of_nodes + nodes], axis=1)
    units = np.ones(numbers.shape[1])
    units[-2 * corners :] = 1 / cell_size
    units[-corners:] *= modulus
    unknowns = np.full((points, d + 2), -1)
    unknowns[:, :d] = np.where(held, -1, np.arange(points * d).reshape(-1, d))
    unknowns[:nodes, d] = points * d + np.arange(nodes)
    unknowns[:nodes, d + 1] = unknowns[:nodes, d] + nodes
    order = unknowns[of_least_degree(cells, points)].ravel()
    return Layout(
        numbers,
        order[order >= 0],
        points * d + 2 * nodes,
        displacements=points * d,
        negative=nodes,
        units=np.outer(units, units),
        beside=[unknowns_of(points_of, d) for points_of in beside],
    )
