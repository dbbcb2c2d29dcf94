r"""Reference cells of linear and quadratic finite elements: points, quadrature, shape functions.

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

The points of quadratic elements are the corners and the middles of edges, and on quadrilaterals and
hexahedra those of faces and of the cell. Each is the mean of some corners, in the order of VTK.
Facets of cells are lines, triangles and quadrilaterals:

=============  ===================================================  ==========================
cell           shape functions                                      quadrature
=============  ===================================================  ==========================
quadrilateral  products of Lagrange's polynomials of 0, 1/2, 1      3 Gauss points along each
and hexahedron along each axis                                      axis
line, triangle :math:`λ_a (2 λ_a - 1)` of corners,                  2, 3, 4 points
and            :math:`4 λ_a λ_b` of edges                           (degree 2; of lines, 3)
tetrahedron
=============  ===================================================  ==========================
"""

from __future__ import annotations

from itertools import product
from math import factorial

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


NAMES = {  # of the cells with all points, as meshio has them
    "line": "line3",
    "triangle": "triangle6",
    "quad": "quad9",
    "tetra": "tetra10",
    "hexahedron": "hexahedron27",
}
LINEAR = {quadratic: linear for linear, quadratic in NAMES.items()}
_SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
BETWEEN: dict[str, tuple[tuple[int, ...], ...]] = {  # corners whose mean is a point
    "line": ((0, 1),),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": (*_SQUARE, (0, 1, 2, 3)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        *_SQUARE,
        *((a + 4, b + 4) for a, b in _SQUARE),
        *((a, a + 4) for a in range(4)),
        *((0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)),
        tuple(range(8)),
    ),
}


def points_of(cell_type: str) -> Array:
    """Points of the reference cell, corners first: (n_points, d), by the name of `NAMES`."""
    linear = LINEAR[cell_type]
    corners = np.array(CORNERS[linear], dtype=np.float64)
    return np.concatenate([corners, [corners[list(some)].mean(0) for some in BETWEEN[linear]]])


def quadratic_quadrature(cell_type: str) -> tuple[Array, Array]:
    """Points (n, d) and weights (n,) in the reference cell, as `datagen` has them."""
    corners = np.array(CORNERS[LINEAR[cell_type]], dtype=np.float64)
    count, d = corners.shape
    if count == d + 1:  # each point nearer to one corner
        share = (1 - 1 / np.sqrt(d + 2)) / (d + 1)
        points = share + (1 - (d + 1) * share) * corners
        return points, np.full(count, 1 / (count * factorial(d)))
    at, weights = np.polynomial.legendre.leggauss(3)
    points = np.array(list(product(0.5 + 0.5 * at, repeat=d)))
    return points, np.array(list(product(0.5 * weights, repeat=d))).prod(axis=1)


def quadratic_shape_values(cell_type: str, at: Array) -> Array:
    """Shape functions N_b at points (n, d) of the reference cell: (n, n_points)."""
    linear, own = LINEAR[cell_type], points_of(cell_type)
    if len(CORNERS[linear]) == own.shape[1] + 1:
        lambdas = shape_values(linear, at)
        edges = [4 * lambdas[:, a] * lambdas[:, b] for a, b in BETWEEN[linear]]
        return np.concatenate([lambdas * (2 * lambdas - 1), np.stack(edges, axis=1)], axis=1)
    return np.asarray(_along_axes(own, at)[0].prod(axis=2))


def quadratic_shape_gradients(cell_type: str, at: Array) -> Array:
    """Derivatives ∂N_b/∂ξ_j at points (n, d) of the reference cell: (n, n_points, d)."""
    linear, own = LINEAR[cell_type], points_of(cell_type)
    d = own.shape[1]
    if len(CORNERS[linear]) == d + 1:
        slopes = shape_gradients(linear, at)  # of λ
        lambdas = shape_values(linear, at)
        edges = [
            4 * (lambdas[:, [a]] * slopes[:, b] + lambdas[:, [b]] * slopes[:, a])
            for a, b in BETWEEN[linear]
        ]
        return np.concatenate(
            [(4 * lambdas - 1)[..., None] * slopes, np.stack(edges, axis=1)], axis=1
        )
    values, derivatives = _along_axes(own, at)
    gradients = [derivatives[..., j] * np.delete(values, j, axis=2).prod(axis=2) for j in range(d)]
    return np.stack(gradients, axis=2)


def _along_axes(own: Array, at: Array) -> tuple[Array, Array]:
    """Lagrange's polynomials of the points of a cell along each axis, and their derivatives.

    They are (n, n_points, d) each, at points (n, d).
    """
    s, place = at[:, None, :], np.rint(2 * own).astype(np.int64)
    values = np.choose(place, [(2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)])
    return values, np.choose(place, [4 * s - 3, 4 - 8 * s, 4 * s - 1])
