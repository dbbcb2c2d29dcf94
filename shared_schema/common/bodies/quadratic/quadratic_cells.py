r"""Reference cells of quadratic elements: points, quadrature, shape functions.

The points are the corners and the middles of edges, and on quadrilaterals and hexahedra those of
faces and of the cell. Each is the mean of some corners, in the order of VTK. Facets of cells are
lines, triangles and quadrilaterals:

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

from shared_schema.common.bodies.reference_cells import CORNERS, shape_gradients, shape_values

Array = NDArray[np.float64]
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
