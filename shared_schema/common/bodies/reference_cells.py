r"""Reference cells of linear finite elements: corners, quadrature, shape functions.

=============  =========================================================  ==================
cell           shape function of corner b                                 quadrature
=============  =========================================================  ==================
quadrilateral  :math:`N_b(ξ) = \prod_j \hat N_{bj}(ξ_j)`, with            2 Gauss points
and            :math:`\hat N_{bj}(s) = s` where corner b has              along each axis
hexahedron     :math:`ξ_j = 1`, and :math:`1 - s` where it has 0
triangle and   :math:`N_0 = 1 - \sum_j ξ_j`, :math:`N_b = ξ_{b-1}`        1 point (exact,
tetrahedron                                                               since F is constant)
=============  =========================================================  ==================

The reference cells have the corners `CORNERS`, in VTK order, between 0 and 1.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CORNERS: dict[str, tuple[tuple[int, ...], ...]] = {  # of the reference cells, in VTK order
    "line": ((0,), (1,)),
    "triangle": ((0, 0), (1, 0), (0, 1)),
    "quad": ((0, 0), (1, 0), (1, 1), (0, 1)),
    "tetra": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "hexahedron": (
        *((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
        *((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ),
}
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)  # of 2 points between -1 and 1


def quadrature(cell_type: str) -> tuple[Array, Array]:
    """Points and weights of the reference cell.

    Returns
    -------
    points : array, (n_points, d)
    weights : array, (n_points,)
        Their sum is the volume of the reference cell.
    """
    corners = np.array(CORNERS[cell_type])
    count, d = corners.shape
    if count == d + 1:
        return np.full((1, d), 1 / (d + 1)), np.full(1, 1 / (2 if d == 2 else 6))
    points = np.array(list(product(0.5 + 0.5 * GAUSS, repeat=d)))
    return points, np.full(len(points), 1 / len(points))


def shape_values(cell_type: str, points: Array) -> Array:
    """Shape functions N_b at points of the reference cell: (n_points, n_corners)."""
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    count, d = corners.shape
    if count == d + 1:
        return np.column_stack([1 - points.sum(axis=1), points])
    at = points[:, None, :]
    return np.asarray(np.where(corners == 1, at, 1 - at).prod(axis=2))


def shape_gradients(cell_type: str, points: Array) -> Array:
    """Derivatives ∂N_b/∂ξ_j at points of the reference cell: (n_points, n_corners, d).

    Parameters
    ----------
    cell_type : str
        Meshio's name of the cells.
    points : array, (n_points, d)
    """
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    count, d = corners.shape
    if count == d + 1:
        constant = np.concatenate([-np.ones((1, d)), np.eye(d)])
        return np.broadcast_to(constant, (len(points), count, d)).copy()
    at = points[:, None, :]
    factors = np.where(corners == 1, at, 1 - at)
    gradients = np.empty((len(points), count, d))
    for j in range(d):
        slope = np.where(corners[:, j] == 1, 1.0, -1.0)
        gradients[:, :, j] = slope * np.delete(factors, j, axis=2).prod(axis=2)
    return gradients
