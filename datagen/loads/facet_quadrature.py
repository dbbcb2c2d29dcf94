"""Gauss quadrature on the facets of a body: edges, triangles and quadrilaterals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])  # of the reference quadrilateral


def shape_functions(corners: int) -> tuple[Array, Array, Array]:
    """Evaluate the shape functions of a facet at its quadrature points.

    Edges have two Gauss points, triangles the three points of degree 2, quadrilaterals 2 × 2.

    Parameters
    ----------
    corners : int
        Number of corners of the facet: 2, 3 or 4.

    Returns
    -------
    values : array, (n_points, n_corners)
        N_a.
    gradients : array, (n_points, n_corners, 1 or 2)
        Derivatives of N_a with respect to the coordinates of the reference facet.
    weights : array, (n_points,)
    """
    if corners == 2:
        values = np.stack([(1 - GAUSS) / 2, (1 + GAUSS) / 2], axis=1)
        gradients = np.broadcast_to([[-0.5], [0.5]], (2, 2, 1))
        return values, np.array(gradients), np.ones(2)
    if corners == 3:
        values = np.full((3, 3), 1 / 6) + 0.5 * np.eye(3)
        gradients = np.broadcast_to([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]], (3, 3, 2))
        return values, np.array(gradients), np.full(3, 1 / 6)
    points = np.stack(np.meshgrid(GAUSS, GAUSS, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    linear = 1 + CORNERS * points
    gradients = np.stack([CORNERS[:, 0] * linear[..., 1], CORNERS[:, 1] * linear[..., 0]], axis=-1)
    return linear.prod(axis=-1) / 4, gradients / 4, np.ones(4)


def facet_points(corners: Array) -> tuple[Array, Array, Array]:
    """Quadrature points of facets in the body, with their areas.

    Parameters
    ----------
    corners : array, (n_facets, n_corners, d)
        Positions in m; edges in the plane, triangles and quadrilaterals in space, in order around
        the facet.

    Returns
    -------
    positions : array, (n_facets, n_points, d)
        In m.
    areas : array, (n_facets, n_points)
        Weight times area element, in m²; the areas of edges are those of a body 1 m thick.
    values : array, (n_points, n_corners)
        Shape functions N_a.
    """
    values, gradients, weights = shape_functions(corners.shape[1])
    positions = np.einsum("qa,fad->fqd", values, corners)
    tangents = np.einsum("qat,fad->fqtd", gradients, corners)
    if tangents.shape[2] == 1:
        elements = np.linalg.norm(tangents[:, :, 0], axis=-1)
    else:
        elements = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=-1)
    return positions, elements * weights, values
