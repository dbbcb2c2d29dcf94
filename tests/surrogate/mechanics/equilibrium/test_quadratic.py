"""Quadratic elements, whose predictions are those of their corners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.reference_cells import (
    NAMES,
    points_of,
    quadratic_quadrature,
)
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.equilibrium.quadratic import on_points
from surrogate.mechanics.solids.deformation import energy_density
from surrogate.mechanics.solids.elements import gradients_at
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

CELLS = ("triangle", "quad", "tetra", "hexahedron")
POINTS = {"triangle": 91, "quad": 91, "tetra": 225, "hexahedron": 225}  # 13 × 7, 9 × 5 × 5


def turned_over(geometry: Geometry) -> np.ndarray:
    """A displacement that inverts all cells."""
    along = np.zeros(geometry.dimension)
    along[0] = -3.0
    return geometry.coordinates * along


@pytest.mark.parametrize("cell_type", CELLS)
def test_shape_functions_and_quadrature(cell_type: str) -> None:
    """Gradients of quadratic fields are exact, and so are integrals of their squares."""
    points = on_points(box(cell_type))
    x, cells, name = points.coordinates, points.cells, points.cell_type
    assert name == NAMES[cell_type]
    assert len(x) == POINTS[cell_type]
    assert cells.shape[1] == len(points_of(name))
    at, weights = quadratic_quadrature(name)
    gradients, determinants = gradients_at(x, cells, name, at)
    assert (weights * np.abs(determinants)).sum() == pytest.approx(2.0, rel=1e-14)
    field = x[:, 0] ** 2 + 3 * x[:, 0] * x[:, 1]
    found = np.einsum("cqbi,cb->cqi", gradients, field[cells])
    integral = (weights * np.abs(determinants) * np.square(found).sum(2)).sum()
    # ∫ (2x + 3y)² + 9x² over 2 × 1 [× 1]
    assert integral == pytest.approx(4 * 8 / 3 + 12 * 2 / 2 + 9 * 2 / 3 + 9 * 8 / 3, rel=1e-12)


@pytest.mark.parametrize("cell_type", CELLS)
def test_homogeneous_deformation(cell_type: str) -> None:
    """E = W(F) V, less where the points of the free surface have moved."""
    geometry = box(cell_type)
    free = replace(geometry, clamped=np.zeros(len(geometry.coordinates), dtype=bool))
    body, d = Equilibrium(free, MATERIAL, on_points=True), geometry.dimension
    change = 0.1 * np.random.default_rng(0).normal(size=(d, d))
    u = (body.geometry.coordinates @ change.T)[None]
    expected = energy_density(torch.from_numpy(np.eye(d) + change), MATERIAL) * 2.0
    assert body.potential(u, 0 * u)[0] == pytest.approx(expected.item(), rel=1e-12)
    moved = body.at_points(u[:, : body.nodes], 0 * u)
    assert body.potential(moved, 0 * u)[0] < expected.item()


@pytest.mark.parametrize("cell_type", CELLS)
def test_points_between_the_nodes_are_in_equilibrium(cell_type: str) -> None:
    """Energy has no slope along them; held and turned-over states stay interpolated."""
    geometry = box(cell_type)
    body = Equilibrium(geometry, MATERIAL, on_points=True)
    u = 0.05 * np.sin(3 * geometry.coordinates)[None] * geometry.free
    points = body.at_points(u, np.zeros((1, *body.free.shape)))
    np.testing.assert_array_equal(points[:, : body.nodes], u)
    assert not points[0, ~body.free].any()
    r = body.out_of_balance(points, 0 * points)[0]
    assert np.abs(r[body.nodes :]).max() < 1e-9 * np.abs(r).max()
    turned = turned_over(geometry)[None]
    expected = geometry.points_between.interpolation @ turned[0]
    np.testing.assert_allclose(body.at_points(turned, 0 * points)[0], expected)
    force = body.forces_at_nodes(r[None])
    assert force.sum((0, 1)) == pytest.approx(r.sum(0), abs=1e-9 * np.abs(r).max())


def test_many_certificates_are_those_of_each() -> None:
    geometry = box("quad")
    body = Equilibrium(geometry, MATERIAL, on_points=True)
    force = np.stack([end_load(geometry, 0.0, y) for y in (-2.0, 1.0, 3.0)])
    predicted = 0.01 * np.sin(force.sum((1, 2), keepdims=True) * geometry.coordinates)
    together = certify(body, force, predicted)
    for row in range(3):
        alone = certify(body, force[row], predicted[row])
        np.testing.assert_allclose(together.error[row], alone.error, rtol=1e-9)
