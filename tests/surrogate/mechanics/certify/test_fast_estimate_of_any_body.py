"""Fast estimates of any material, element and load, against true errors and Newton's products."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import torch

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.grid import Grid
from shared_schema.materials import (
    Gent,
    HolzapfelGasserOgden,
    Materials,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
)
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify import fast_estimate
from surrogate.mechanics.certify.calibrated_range import LEAST_STIFFNESS
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.fast_certificate import LEAST, with_rest
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.descent import DrivenBody
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import cells_of

SHAPE, SIZE = (6, 3), (3.0, 1.0)
MATERIALS: dict[str, Materials] = {
    "Neo-Hooke": NeoHookean(young_modulus=500, poisson_ratio=0.45),
    "Yeoh": Yeoh(c10=85, c20=20, c30=4, bulk_modulus=1700),
    "Ogden": Ogden(mu=(150, -20), alpha=(2.0, -2.0), bulk_modulus=1500),
    "fibres": HolzapfelGasserOgden(
        c10=70, k1=150, k2=3, kappa=0.1, bulk_modulus=1500, fibres=((0.8, 0.6),)
    ),
    "two kinds": (
        MooneyRivlin(c10=60, c01=25, bulk_modulus=1700, group="root"),
        Gent(shear_modulus=100, limit=40, bulk_modulus=1000, group="end"),
    ),
}
ELEMENTS = ("linear", "quadratic", "mean dilation", "Taylor-Hood")
LOADS = ("force", "pressure", "both")


@cache
def geometry_of(material: str, element: str) -> Geometry:
    """A beam of 3 × 1 m, clamped at x = 0, whose upper side may be under pressure."""
    cell_type = "quad" if element == "mean dilation" else "triangle"
    x = np.argwhere(np.ones(SHAPE)) / (np.array(SHAPE) - 1) * SIZE
    cells = cells_of(cell_type, SHAPE)
    facets = outward_facets(x, cells, cell_type)
    return Geometry(
        coordinates=x,
        cells=cells,
        cell_type=cell_type,
        clamped=x[:, 0] == 0,
        loadable=x[:, 0] > 0,
        grid=Grid.from_coordinates(x),
        pressed=facets[(x[facets, 1] == SIZE[1]).all(axis=1)],
        mean_dilation=element in ("mean dilation", "Taylor-Hood"),
        has_points_between=element in ("quadratic", "Taylor-Hood"),
        fibres=np.tile([[0.8, 0.6]], (len(cells), 1, 1)) if material == "fibres" else None,
        parts=(x[cells, 0].mean(axis=1) > 1).astype(int) if material == "two kinds" else None,
    )


@cache
def estimate_of(material: str, element: str) -> FastEstimate:
    geometry = geometry_of(material, element)
    on_points = geometry.has_points_between
    return FastEstimate(DrivenBody.of(Equilibrium(geometry, MATERIALS[material], on_points)))


def load_of(geometry: Geometry, load: str) -> tuple[np.ndarray, FollowingLoads | None]:
    """A force at the free end, a pressure of 1.2 Pa from above, or half of both."""
    force, part = np.zeros_like(geometry.coordinates), 0.5 if load == "both" else 1.0
    if load != "pressure":
        force[-1] = 0.3 * part, -1.2 * part
    if load == "force":
        return force, None
    return force, FollowingLoads.of(geometry, np.array([[1.2 * part]]))


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("material", MATERIALS)
def test_estimated_and_true_error(material: str, element: str, load: str) -> None:
    """A prediction that is wrong by 2 % of what the body moves, smoothly and from node to node."""
    geometry, fast = geometry_of(material, element), estimate_of(material, element)
    force, pressure = load_of(geometry, load)
    body, x = fast.equilibrium, geometry.coordinates
    under = body if pressure is None else body.under(pressure)
    truth = correct(under, force, 0 * x).displacement
    size = np.abs(truth).max()
    assert size > 0.08  # of 3 m
    smooth = (x[:, :1] / 3) ** 2 * [0.6, -0.8]
    rough = 0.03 * np.sin(7 * x[:, ::-1] + 5 * x)
    predicted = truth + 0.02 * size * np.where(geometry.held, 0, smooth + rough)
    found = fast.with_stability(force[None], predicted[None], pressure)
    wrong, bounds = predicted - truth, with_rest(*found)
    assert found[2][0] > LEAST_STIFFNESS
    assert np.linalg.norm(found[0][0] - wrong) < 0.4 * np.linalg.norm(wrong)
    assert np.abs(wrong).mean() <= LEAST * bounds["mean"][0]
    assert np.linalg.norm(wrong, axis=1).max() <= LEAST * bounds["largest"][0]
    inverted = predicted.copy()
    inverted[-1] = -x[-1] - 1
    error, _, softest = fast.with_stability(force[None], inverted[None], pressure)
    assert np.isinf(error[0, -1]).all()
    assert softest[0] == -np.inf


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("material", MATERIALS)
def test_products_are_those_of_the_solid(material: str, element: str) -> None:
    """K(u) x, by a central difference of the internal forces in PyTorch."""
    fast = estimate_of(material, element)
    body, step = fast.equilibrium, 1e-5
    u, x = 0.02 * np.random.default_rng(1).normal(size=(2, *body.free.shape)) * body.free

    def forces(field: np.ndarray) -> np.ndarray:
        return np.asarray(body.solid.internal_forces(torch.from_numpy(field[None])).numpy())[0]

    nothing = np.zeros_like(u)
    state = fast.body.state(u, nothing)
    assert state is not None
    found = fast.body.product(state, nothing, x)
    assert found is not None
    expected = (forces(u + step * x) - forces(u - step * x)) / (2 * step) * body.free
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_many_steps_end_at_newtons_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Muscle-like fibres on quadratic triangles: the error of linearised equations to 1e-5."""
    monkeypatch.setattr(fast_estimate, "STEPS", 8)
    geometry, fast = geometry_of("fibres", "quadratic"), estimate_of("fibres", "quadratic")
    force, _ = load_of(geometry, "force")
    predicted = correct(fast.equilibrium, 0.98 * force, 0 * force).displacement[None]
    body = fast.equilibrium
    f = body.forces_at_points(force[None])
    u = body.at_points(predicted, f)
    step, _ = body.newton_step(u, body.out_of_balance(u, f))
    expected = -step[:, : body.nodes]
    found = fast(force[None], predicted)
    assert np.linalg.norm(found - expected) < 1e-5 * np.linalg.norm(expected)
