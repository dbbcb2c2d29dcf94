"""Consistent forces on the points of quadratic elements, by integrals over a square and a cube."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.distributed_loads import (
    area_vectors,
    facet_derivatives,
    facet_shares,
    nodal_volumes,
)
from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.bodies.reference_cells import (
    NAMES,
    points_of,
    quadratic_shape_gradients,
    quadratic_shape_values,
)

SQUARE = np.array([[0, 0], [0.4, 0], [1, 0], [1, 1], [0.7, 1], [0, 1]], dtype=float)
HALVES = np.array([[0, 1, 4, 5], [1, 2, 3, 4]])  # of the square, with a slanted line between
CELLS = ("triangle", "quad", "tetra", "hexahedron")


def unit_body(cell_type: str) -> tuple[np.ndarray, np.ndarray, PointsBetween]:
    """Coordinates and cells of the square or cube from 0 to 1, and its points."""
    if cell_type in ("triangle", "quad"):
        x, cells = SQUARE, HALVES
        if cell_type == "triangle":
            cells = np.concatenate([cells[:, [0, 1, 2]], cells[:, [2, 0, 3]]])
    elif cell_type == "hexahedron":
        x = np.concatenate([np.column_stack([SQUARE, np.full(6, z)]) for z in (0.0, 1.0)])
        cells = np.concatenate([HALVES, HALVES + 6], axis=1)
    else:  # Kuhn's 6 tetrahedra: from one corner to the opposite, along the axes in any order
        x = np.array(list(product((0.0, 1.0), repeat=3)))
        steps = [np.cumsum([0, *order]) for order in permutations((4, 2, 1))]
        cells = np.array(steps)
    return x, cells, PointsBetween.of(cells, cell_type, len(x))


def quadratics(x: np.ndarray) -> np.ndarray:
    """Polynomials 1, x_i and x_i x_j at points: (n_points, n)."""
    d = x.shape[1]
    squares = [x[:, i] * x[:, j] for i in range(d) for j in range(i, d)]
    return np.column_stack([np.ones(len(x)), x, *squares])


def their_means(d: int) -> np.ndarray:
    """Integrals of `quadratics` from 0 to 1 along every axis: 1, 1/2, and 1/3 or 1/4."""
    squares = [1 / 3 if i == j else 1 / 4 for i in range(d) for j in range(i, d)]
    return np.array([1.0, *[0.5] * d, *squares])


@pytest.mark.parametrize("cell_type", NAMES.values())
def test_shape_functions(cell_type: str) -> None:
    """N_b is 1 at its own point and 0 at the others; slopes are those of differences."""
    own = points_of(cell_type)
    assert quadratic_shape_values(cell_type, own) == pytest.approx(np.eye(len(own)), abs=1e-14)
    at, h = np.full((1, own.shape[1]), 0.21), 1e-6
    found = quadratic_shape_gradients(cell_type, at)[0]
    for j, step in enumerate(h * np.eye(own.shape[1])):
        upper, lower = (quadratic_shape_values(cell_type, at + s * step)[0] for s in (1, -1))
        assert found[:, j] == pytest.approx((upper - lower) / (2 * h), abs=1e-8)


@pytest.mark.parametrize("cell_type", CELLS)
def test_body_force_does_its_work_in_quadratic_displacements(cell_type: str) -> None:
    """Σ_b f_b q(x_b) = ∫ q dV for every quadratic polynomial; Σ_a f¹_a N_a is that of linear ones.

    The forces at the nodes are those of linear elements.
    """
    x, cells, points = unit_body(cell_type)
    positions = points.interpolation @ x
    volumes = nodal_volumes(positions, points.cells)
    assert volumes @ quadratics(positions) == pytest.approx(their_means(x.shape[1]), rel=1e-13)
    of_nodes = points.on_nodes(volumes[:, None])[:, 0]
    assert of_nodes == pytest.approx(nodal_volumes(x, cells), rel=1e-13)


@pytest.mark.parametrize("cell_type", CELLS)
def test_traction_does_its_work_in_quadratic_displacements(cell_type: str) -> None:
    """The same on one side, where y = 1 (a line from 0 to 1, or a square)."""
    x, cells, points = unit_body(cell_type)
    facets = outward_facets(x, cells, cell_type)
    corners = facets[(x[facets][..., 1] == 1).all(axis=1)]
    positions, facets = points.interpolation @ x, points.facets(corners)
    shares = np.zeros(points.count)
    np.add.at(shares, facets, facet_shares(positions[facets]))
    side = np.delete(positions, 1, axis=1)
    assert shares @ quadratics(side) == pytest.approx(their_means(x.shape[1] - 1), rel=1e-13)
    linear = np.zeros(len(x))
    np.add.at(linear, corners, facet_shares(x[corners]))
    assert points.on_nodes(shares[:, None])[:, 0] == pytest.approx(linear, rel=1e-13, abs=1e-16)


def test_hand_calculation() -> None:
    """An edge: 1/6, 1/6 and 4/6; a triangle: 0 and 1/3; a tetrahedron: -1/20 and 1/5."""
    edge = np.array([[[0.0, 0], [3, 0], [1.5, 0]]])
    assert facet_shares(edge)[0] == pytest.approx(3 * np.array([1 / 6, 1 / 6, 4 / 6]))
    triangle = points_of("triangle6") @ np.eye(2, 3)
    assert facet_shares(triangle[None])[0] == pytest.approx([0, 0, 0, *[1 / 6] * 3])
    volumes = nodal_volumes(points_of("tetra10"), np.arange(10)[None])
    assert volumes == pytest.approx(np.array([*[-1 / 20] * 4, *[1 / 5] * 6]) / 6)


@pytest.mark.parametrize("cell_type", CELLS)
def test_pressure_on_a_curved_closed_surface(cell_type: str) -> None:
    """∮ n dS = 0, ∮ x × n dS = 0, and ∮ N_b n dS is the derivative of the volume by x_b.

    All points are moved at random, so that facets are curved. The volume is ∮ x · n dS / d.
    """
    x, cells, points = unit_body(cell_type)
    facets = points.facets(outward_facets(x, cells, cell_type))
    d = x.shape[1]
    random = np.random.default_rng(3)
    positions = points.interpolation @ x
    assert (area_vectors(positions, facets) * positions).sum() == pytest.approx(d, rel=1e-13)
    positions = positions + random.uniform(-0.1, 0.1, positions.shape)
    areas = area_vectors(positions, facets)
    assert areas.sum(axis=0) == pytest.approx(0, abs=1e-14)
    moments = np.einsum("ai,aj->ij", positions, areas)
    assert moments == pytest.approx(moments.T, abs=1e-14)
    change, h = random.normal(size=positions.shape), 1e-5
    volumes = [
        (area_vectors(at, facets) * at).sum() / d
        for at in (positions + h * change, positions - h * change)
    ]
    assert (areas * change).sum() == pytest.approx((volumes[0] - volumes[1]) / (2 * h), rel=1e-8)


@pytest.mark.parametrize("cell_type", CELLS)
def test_derivative_of_pressure_on_curved_facets(cell_type: str) -> None:
    """Central differences of the forces of a pressure of -1 Pa."""
    x, cells, points = unit_body(cell_type)
    facet = points.facets(outward_facets(x, cells, cell_type)[:1])[0]
    random, h = np.random.default_rng(4), 1e-6
    at = (points.interpolation @ x)[facet] + random.uniform(-0.1, 0.1, (len(facet), x.shape[1]))
    alone = np.arange(len(facet))[None]
    found = facet_derivatives(at, alone, -1.0)[0]
    for column, step in enumerate(np.eye(at.size)):
        change = h * step.reshape(at.shape)
        slope = (area_vectors(at + change, alone) - area_vectors(at - change, alone)) / (2 * h)
        assert found[:, column] == pytest.approx(slope.ravel(), abs=1e-8)


@pytest.mark.parametrize("cell_type", CELLS)
def test_forces_between_and_at_the_nodes_are_those_on_all_points(cell_type: str) -> None:
    """f¹ and g give f² back; f¹ does the work of f² in linear displacements."""
    x, _, points = unit_body(cell_type)
    random = np.random.default_rng(5)
    forces = random.normal(size=(2, points.count, x.shape[1]))
    at_nodes = points.on_nodes(forces)
    again = points.on_points(at_nodes, forces[:, points.nodes :])
    assert again == pytest.approx(forces, abs=1e-14)
    u = random.normal(size=x.shape)
    work = (forces * (points.interpolation @ u)).sum(axis=(1, 2))
    assert (at_nodes * u).sum(axis=(1, 2)) == pytest.approx(work, abs=1e-13)


def test_points_are_numbered_by_their_corners() -> None:
    """Two quadrilaterals side by side: 7 edges and 2 centres, in the order of their corners."""
    points = unit_body("quad")[2]
    centres = [[0, 1, 4, 5], [1, 2, 3, 4]]
    edges = [[a, b, -1, -1] for a, b in ((0, 1), (0, 5), (1, 2), (1, 4), (2, 3), (3, 4), (4, 5))]
    assert points.corners.tolist() == sorted([*edges, *centres])
    assert points.facets(np.array([[4, 1]])).tolist() == [[4, 1, 6 + 5]]
    with pytest.raises(ValueError, match="no such point"):
        points.facets(np.array([[0, 4]]))
