r"""Gauss quadrature on the facets of a body, and the nodal forces of a pressure on them.

A pressure p on the facets Γ, whose outward normal is n, has the nodal forces

.. math:: f_a = -p \int_{Γ} N_a \, n \, dS,

in N if Γ is that of the present (deformed or undeformed) body. With the tangents
:math:`t_k = \sum_b ∂N_b/∂ξ_k \, x_b` of a facet, n dS is :math:`t_1 × t_2` (in the plane, the
tangent turned by 90°), and the derivative of the forces with respect to the position of corner b is

.. math::
    \frac{∂f_a}{∂x_b} e = -p \sum_q w_q N_a \left(
    \frac{∂N_b}{∂ξ_1} \, e × t_2 + \frac{∂N_b}{∂ξ_2} \, t_1 × e \right).

It is not symmetric (Bonet and Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*,
Section 8.5.2). Facets are edges, triangles and quadrilaterals. In two dimensions the body is 1 m
thick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.reference_cells import CORNERS, GAUSS

Array = NDArray[np.float64]
SIGNS = 2 * np.array(CORNERS["quad"]) - 1  # corners of the quadrilateral between -1 and 1


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
    linear = 1 + SIGNS * points
    gradients = np.stack([SIGNS[:, 0] * linear[..., 1], SIGNS[:, 1] * linear[..., 0]], axis=-1)
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


def normals_of(tangents: Array) -> Array:
    """Outward normals times area elements, from the tangents of facets seen from outside.

    Parameters
    ----------
    tangents : array, (n_facets, n_points, d - 1, d)

    Returns
    -------
    array, (n_facets, n_points, d)
    """
    if tangents.shape[2] == 1:
        t = tangents[:, :, 0]
        return np.stack([t[..., 1], -t[..., 0]], axis=-1)
    return np.cross(tangents[:, :, 0], tangents[:, :, 1])


def facet_tangents(corners: Array) -> tuple[Array, Array, Array]:
    """Tangents of facets at their quadrature points.

    Parameters
    ----------
    corners : array, (n_facets, n_corners, d)
        Positions in m, in order around the facet.

    Returns
    -------
    tangents : array, (n_facets, n_points, d - 1, d)
    weighted_values : array, (n_points, n_corners)
        Quadrature weight times shape function N_a.
    gradients : array, (n_points, n_corners, d - 1)
    """
    values, gradients, weights = shape_functions(corners.shape[1])
    tangents = np.einsum("qat,fad->fqtd", gradients, corners)
    return tangents, weights[:, None] * values, gradients


def area_vectors(positions: Array, facets: NDArray[np.int64]) -> Array:
    """Integrate N_a n over facets for every node: (n_nodes, d) in m².

    Parameters
    ----------
    positions : array, (n_nodes, d)
        Positions of the nodes in m.
    facets : array of int, (n_facets, n_corners)
        Node numbers, seen from outside (`shared_schema.common.bodies.cells.outward_facets`).
    """
    tangents, weighted, _ = facet_tangents(positions[facets])
    total = np.zeros(positions.shape)
    np.add.at(total, facets, np.einsum("qa,fqd->fad", weighted, normals_of(tangents)))
    return total


def pressure_forces(positions: Array, facets: NDArray[np.int64], pressure: float) -> Array:
    """Nodal forces of a pressure in Pa on facets of the present body: (n_nodes, d) in N."""
    return -pressure * area_vectors(positions, facets)


def facet_derivatives(positions: Array, facets: NDArray[np.int64], pressure: float) -> Array:
    """Derivatives of the nodal forces of every facet: (n_facets, corners · d, corners · d) in N/m.

    Parameters
    ----------
    positions : array, (n_nodes, d)
        Positions of the nodes on the present body in m.
    facets : array of int, (n_facets, corners)
    pressure : float
        In Pa.
    """
    tangents, weighted, gradients = facet_tangents(positions[facets])
    count, points, _, d = tangents.shape
    change = np.zeros((count, points, facets.shape[1], d, d))  # of n dS, by corner and component
    for along in range(d - 1):
        for component in range(d):
            moved = tangents.copy()
            moved[:, :, along] = np.eye(d)[component]
            by_unit = normals_of(moved)  # linear in each tangent
            change[..., component] += gradients[None, :, :, along, None] * by_unit[:, :, None]
    blocks = -pressure * np.einsum("qa,fqbij->faibj", weighted, change)
    size = facets.shape[1] * d
    return blocks.reshape(count, size, size)


def facet_shares(corners: Array) -> Array:
    """Integrate N_a over each facet, for each of its corners: (n_facets, n_corners) in m².

    Parameters
    ----------
    corners : array, (n_facets, n_corners, d)
        Positions in m, in order around the facet.
    """
    _, areas, values = facet_points(corners)
    return areas @ values
