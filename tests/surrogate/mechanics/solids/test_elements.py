"""Elements against polynomials that they integrate or differentiate exactly."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.bodies.reference_cells import CORNERS, quadrature
from surrogate.mechanics.solids.elements import cell_gradients

VOLUMES = {"triangle": 1 / 2, "quad": 1.0, "tetra": 1 / 6, "hexahedron": 1.0}


@pytest.mark.parametrize("cell_type", VOLUMES)
def test_linear_fields_have_their_gradient(cell_type: str) -> None:
    """On a cell under a random affine map x = A ξ + b, whose volume is |det A| times that of ξ."""
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    d = corners.shape[1]
    rng = np.random.default_rng(0)
    a = np.eye(d) + 0.3 * rng.normal(size=(d, d))
    x = corners @ a.T + rng.normal(size=d)
    slope = rng.normal(size=d)
    gradients, volumes = cell_gradients(x, np.arange(len(x))[None], cell_type)
    found = np.einsum("cqbj,b->cqj", gradients, x @ slope)
    np.testing.assert_allclose(found, np.broadcast_to(slope, found.shape), atol=1e-13)
    assert volumes.sum() == pytest.approx(abs(np.linalg.det(a)) * VOLUMES[cell_type])


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_two_gauss_points_integrate_cubic_polynomials(cell_type: str) -> None:
    """∫ ξ₀³ ξ₁² over the unit cell is 1/4 · 1/3."""
    points, weights = quadrature(cell_type)
    assert (weights * points[:, 0] ** 3 * points[:, 1] ** 2).sum() == pytest.approx(1 / 12)


def test_bilinear_field() -> None:
    """u = x y on [0, 2] × [0, 1] has the gradient (y, x)."""
    x = np.array([[0.0, 0.0], [2, 0], [2, 1], [0, 1]])
    gradients, _ = cell_gradients(x, np.arange(4)[None], "quad")
    points, _ = quadrature("quad")
    found = np.einsum("qbj,b->qj", gradients[0], x[:, 0] * x[:, 1])
    np.testing.assert_allclose(found, np.stack([points[:, 1], 2 * points[:, 0]], axis=1))
