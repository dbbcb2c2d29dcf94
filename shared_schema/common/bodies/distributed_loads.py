r"""Consistent forces of distributed loads: pressures, forces per volume, and smooth patches.

A pressure p on the facets Γ, whose outward normal is n, has the forces

.. math:: f_a = -p \int_{Γ} N_a \, n \, dS,

in N if Γ is that of the present (deformed or undeformed) body. With the tangents
:math:`t_k = \sum_b ∂N_b/∂ξ_k \, x_b` of a facet, n dS is :math:`t_1 × t_2` (in the plane, the
tangent turned by 90°), and the derivative of the forces with respect to the position of point b is

.. math::
    \frac{∂f_a}{∂x_b} e = -p \sum_q w_q N_a \left(
    \frac{∂N_b}{∂ξ_1} \, e × t_2 + \frac{∂N_b}{∂ξ_2} \, t_1 × e \right).

It is not symmetric (Bonet and Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*,
Section 8.5.2).

Points of a facet are its corners, in order around it, and, on a quadratic element, those between
them; a deformed facet is curved then. Forces of pressures are exact:

=============  ====================================  =========================================
facet          points                                quadrature
=============  ====================================  =========================================
edge           2, or 3 in the plane                  2 Gauss points, or 3
triangle       3, or 6                               3 points of degree 2, or 6 of degree 4
quadrilateral  4, or 9                               2 Gauss points along each axis, or 3
=============  ====================================  =========================================

The 6 points are those of Dunavant (1985), *Int. J. Numer. Methods Engrg.* 21, 1129-1148.

A force density b, in N per m³ of the undeformed body, has the consistent forces

.. math:: f_a = b \int_{Ω} N_a \, dV

in N on the points of the cells. A smooth patch on a surface has the weights of points

.. math:: w_a = \int_{Γ} N_a \, \Big(1 - \frac{|x - c|^2}{R^2}\Big)^2 \, dS
   \quad \text{over } |x - c| < R

with the centre c and the radius R. A traction of the largest value t has the nodal forces
:math:`w_a t`. The integral is by Gauss quadrature. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.reference_cells import (
    LINEAR,
    quadratic_quadrature,
    quadratic_shape_gradients,
    quadratic_shape_values,
    quadrature,
    shape_gradients,
    shape_values,
)

Array = NDArray[np.float64]
NAMES = {  # of facets, by d, number of points
    **{(2, 2): "line", (2, 3): "line3", (3, 3): "triangle", (3, 6): "triangle6"},
    **{(3, 4): "quad", (3, 9): "quad9"},
}
ORBITS = {  # barycentric coordinate of one corner, and weight, of 3 points each
    "triangle": ((2 / 3, 1 / 3),),
    "triangle6": (
        (0.108103018168070, 0.223381589678011),
        (0.816847572980459, 0.109951743655322),
    ),
}


def shape_functions(points: int, d: int) -> tuple[Array, Array, Array]:
    """Evaluate the shape functions of a facet at its quadrature points.

    Parameters
    ----------
    points : int
        Number of points of the facet.
    d : int
        Number of space dimensions of the body.

    Returns
    -------
    values : array, (n_quadrature, n_points)
        N_a.
    gradients : array, (n_quadrature, n_points, d - 1)
        Derivatives of N_a with respect to the coordinates of the reference facet.
    weights : array, (n_quadrature,)
    """
    facet = NAMES[d, points]
    at, weights = _quadrature(facet)
    if facet in LINEAR:
        return quadratic_shape_values(facet, at), quadratic_shape_gradients(facet, at), weights
    return shape_values(facet, at), shape_gradients(facet, at), weights


def _quadrature(facet: str) -> tuple[Array, Array]:
    """Points (n, d - 1) and weights (n,) of a reference facet."""
    if facet in ORBITS:
        orbits = ORBITS[facet]
        points = [np.full((3, 3), (1 - a) / 2) + (1.5 * a - 0.5) * np.eye(3) for a, _ in orbits]
        return np.concatenate(points)[:, 1:], np.repeat([weight / 2 for _, weight in orbits], 3)
    if facet.startswith("line"):
        at, weights = np.polynomial.legendre.leggauss(2 if facet == "line" else 3)
        return (0.5 + 0.5 * at)[:, None], 0.5 * weights
    return quadrature(facet) if facet == "quad" else quadratic_quadrature(facet)


def facet_points(points: Array) -> tuple[Array, Array, Array]:
    """Quadrature points of facets in the body, with their areas.

    Parameters
    ----------
    points : array, (n_facets, n_points, d)
        Positions of the points of the facets in m.

    Returns
    -------
    positions : array, (n_facets, n_quadrature, d)
        In m.
    areas : array, (n_facets, n_quadrature)
        Weight times area element, in m²; the areas of edges are those of a body 1 m thick.
    values : array, (n_quadrature, n_points)
        Shape functions N_a.
    """
    values, gradients, weights = shape_functions(*points.shape[1:])
    positions = np.einsum("qa,fad->fqd", values, points)
    tangents = np.einsum("qat,fad->fqtd", gradients, points)
    if tangents.shape[2] == 1:
        elements = np.linalg.norm(tangents[:, :, 0], axis=-1)
    else:
        elements = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=-1)
    return positions, elements * weights, values


def normals_of(tangents: Array) -> Array:
    """Outward normals times area elements, from the tangents of facets seen from outside.

    Parameters
    ----------
    tangents : array, (n_facets, n_quadrature, d - 1, d)

    Returns
    -------
    array, (n_facets, n_quadrature, d)
    """
    if tangents.shape[2] == 1:
        t = tangents[:, :, 0]
        return np.stack([t[..., 1], -t[..., 0]], axis=-1)
    return np.cross(tangents[:, :, 0], tangents[:, :, 1])


def facet_tangents(points: Array) -> tuple[Array, Array, Array]:
    """Tangents of facets at their quadrature points.

    Parameters
    ----------
    points : array, (n_facets, n_points, d)
        Positions of the points of the facets in m.

    Returns
    -------
    tangents : array, (n_facets, n_quadrature, d - 1, d)
    weighted_values : array, (n_quadrature, n_points)
        Quadrature weight times shape function N_a.
    gradients : array, (n_quadrature, n_points, d - 1)
    """
    values, gradients, weights = shape_functions(*points.shape[1:])
    tangents = np.einsum("qat,fad->fqtd", gradients, points)
    return tangents, weights[:, None] * values, gradients


def area_vectors(positions: Array, facets: NDArray[np.int64]) -> Array:
    """Integrate N_a n over facets for every point: (n_points, d) in m².

    Parameters
    ----------
    positions : array, (n_points, d)
        Positions of the points of the body in m; all of them are nodes of linear elements.
    facets : array of int, (n_facets, n_points of a facet)
        Numbers of points, seen from outside (`shared_schema.common.bodies.cells.outward_facets`).
    """
    tangents, weighted, _ = facet_tangents(positions[facets])
    total = np.zeros(positions.shape)
    np.add.at(total, facets, np.einsum("qa,fqd->fad", weighted, normals_of(tangents)))
    return total


def pressure_forces(positions: Array, facets: NDArray[np.int64], pressure: float) -> Array:
    """Forces of a pressure in Pa on facets of the present body: (n_points, d) in N."""
    return -pressure * area_vectors(positions, facets)


def facet_derivatives(positions: Array, facets: NDArray[np.int64], pressure: float) -> Array:
    """Derivatives of the forces of every facet: (n_facets, points · d, points · d) in N/m.

    Parameters
    ----------
    positions : array, (n_points, d)
        Positions of the points on the present body in m.
    facets : array of int, (n_facets, points)
    pressure : float
        In Pa.
    """
    tangents, weighted, gradients = facet_tangents(positions[facets])
    count, at, _, d = tangents.shape
    change = np.zeros((count, at, facets.shape[1], d, d))  # of n dS, by point and component
    for along in range(d - 1):
        for component in range(d):
            moved = tangents.copy()
            moved[:, :, along] = np.eye(d)[component]
            by_unit = normals_of(moved)  # linear in each tangent
            change[..., component] += gradients[None, :, :, along, None] * by_unit[:, :, None]
    blocks = -pressure * np.einsum("qa,fqbij->faibj", weighted, change)
    size = facets.shape[1] * d
    return blocks.reshape(count, size, size)


def facet_shares(points: Array) -> Array:
    """Integrate N_a over each facet, for each of its points: (n_facets, n_points) in m².

    Parameters
    ----------
    points : array, (n_facets, n_points, d)
        Positions of the points of the facets in m.
    """
    _, areas, values = facet_points(points)
    return areas @ values


SIMPLICES = {  # shares of a simplex with straight edges: of its corners, and of the edges' middles
    (2, 6): (0.0, 1 / 3),
    (3, 10): (-1 / 20, 1 / 5),
}
QUADRATIC = {(2, 9): "quad9", (3, 27): "hexahedron27"}  # by d, number of points


def nodal_volumes(coordinates: Array, cells: NDArray[np.int64]) -> Array:
    """Integrate N_a over some cells for every point: (n_points,) in m³.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the points of the body in m; all of them are nodes of linear elements.
    cells : array of int, (n_cells, n_points of a cell)
        Numbers of points, VTK order.
    """
    volumes = np.zeros(len(coordinates))
    np.add.at(volumes, cells, cell_shares(coordinates[cells]))
    return volumes


def cell_shares(points: Array) -> Array:
    """Integrate N_a over each cell, for each of its points.

    Parameters
    ----------
    points : array, (n_cells, n_points, d)
        Positions of the points of the cells in m, VTK order. Cells have straight edges.

    Returns
    -------
    array, (n_cells, n_points)
        In m³; cells in the plane are 1 m thick.
    """
    count, d = points.shape[1:]
    if count == d + 1 or (d, count) in SIMPLICES:
        volume = np.abs(np.linalg.det(points[:, 1 : d + 1] - points[:, :1])) / factorial(d)
        of_corners, of_edges = SIMPLICES.get((d, count), (1 / (d + 1), 0.0))
        return np.outer(volume, np.where(np.arange(count) <= d, of_corners, of_edges))
    if (d, count) in QUADRATIC:
        cell = QUADRATIC[d, count]
        at, weights = quadratic_quadrature(cell)
        values, slopes = quadratic_shape_values(cell, at), quadratic_shape_gradients(cell, at)
    else:
        cell = "quad" if d == 2 else "hexahedron"
        at, weights = quadrature(cell)
        values, slopes = shape_values(cell, at), shape_gradients(cell, at)
    jacobians = np.einsum("cai,qaj->cqij", points, slopes)
    return np.asarray(np.abs(np.linalg.det(jacobians)) * weights @ values)


@dataclass(frozen=True)
class SurfacePatches:
    """Facets of a surface with their quadrature (`facet_points`).

    Attributes
    ----------
    nodes : int
        Number of nodes of the mesh.
    facets : array of int, (n_facets, n_corners)
    positions : array, (n_facets, n_points, d)
        In m.
    areas : array, (n_facets, n_points)
        In m².
    values : array, (n_points, n_corners)
    """

    nodes: int
    facets: NDArray[np.int64]
    positions: Array
    areas: Array
    values: Array

    @classmethod
    def of(cls, coordinates: Array, facets: NDArray[np.int64]) -> SurfacePatches:
        """Take facets of a mesh whose nodes are at (n_nodes, d) in m."""
        return cls(len(coordinates), facets, *facet_points(coordinates[facets]))

    def weights(self, centre: Array, radius: float) -> Array:
        """Integrate for every node: (n_nodes,) in m², all zero where no facet is in reach."""
        squares = ((self.positions - centre) ** 2).sum(axis=-1) / radius**2
        reached = (squares < 1).any(axis=1)
        profile = np.clip(1 - squares[reached], 0, None) ** 2
        weights = np.zeros(self.nodes)
        np.add.at(weights, self.facets[reached], (profile * self.areas[reached]) @ self.values)
        return weights
