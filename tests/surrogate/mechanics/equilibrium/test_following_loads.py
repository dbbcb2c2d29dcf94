"""Bodies under pressures that follow the surface: tangents, equilibria, certificates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.following_loads import PressedSurface
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.certify.correction import correct, increased
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

KINDS = ["triangle", "quad", "tetra", "hexahedron", "quad, mean dilation"]


def body(kind: str) -> Geometry:
    cell_type, _, mean = kind.partition(",")
    return replace(box(cell_type), mean_dilation=bool(mean))


def pressed(geometry: Geometry, pressure: float) -> FollowingLoads:
    """A pressure on the upper half of the far end and on the top: its edge is free."""
    x = geometry.coordinates
    facets = outward_facets(x, geometry.cells, geometry.cell_type)
    at_end = ((x[facets, 0] == 2) & (x[facets, 1] >= 0.5)).all(axis=1)
    on_top = (x[facets, 1] == 1).all(axis=1)
    units = PressedSurface(facets[at_end]), PressedSurface(facets[on_top])
    return FollowingLoads(x, units, np.array([[2.0, 1.0]]) * pressure)


@pytest.mark.parametrize("kind", KINDS)
def test_step_is_that_of_the_derivative(kind: str) -> None:
    """K δ = −r, with K by central differences of r, which is not symmetric."""
    geometry = body(kind)
    equilibrium = Equilibrium(geometry, MATERIAL).under(pressed(geometry, 9.0))
    random = np.random.default_rng(0)
    u = np.where(equilibrium.free, 0.02 * random.normal(size=geometry.coordinates.shape), 0)[None]
    f = np.zeros_like(u)
    r = equilibrium.out_of_balance(u, f)
    step, h = equilibrium.newton_step(u, r)[0], 1e-6
    change = h * step / np.abs(step).max()
    ahead, behind = (equilibrium.out_of_balance(u + s * change, f) for s in (1, -1))
    found = (ahead - behind) / (2 * h) * np.abs(step).max()
    np.testing.assert_allclose(found, -r, atol=1e-6 * np.abs(r).max())


@pytest.mark.parametrize("kind", KINDS)
def test_any_prediction_leads_to_the_equilibrium(kind: str) -> None:
    """Load steps from the undeformed body, and wrong predictions, end at one displacement."""
    geometry = body(kind)
    equilibrium = Equilibrium(geometry, MATERIAL).under(pressed(geometry, 9.0))
    x, random = geometry.coordinates, np.random.default_rng(0)
    force = end_load(geometry, *(1.0, -2.0, 0.5)[: x.shape[1]])
    truth = increased(equilibrium, force[None]).displacement
    assert 0.1 < np.abs(truth).max() < 1.5
    for predicted in (truth, 1.1 * truth, -truth, random.normal(size=x.shape), x * np.nan):
        found = correct(equilibrium, force, predicted)
        assert found.residual_norm <= 1e-8
        np.testing.assert_allclose(found.displacement, truth, atol=1e-8)
    at_rest = equilibrium.at_rest(force[None])[0]
    dead = correct(Equilibrium(geometry, MATERIAL), at_rest, truth)
    assert np.abs(dead.displacement - truth).max() > 0.02  # pressures that follow are others


def test_estimate_is_of_third_order() -> None:
    geometry = body("hexahedron")
    equilibrium = Equilibrium(geometry, MATERIAL).under(pressed(geometry, 9.0))
    x, force = geometry.coordinates, end_load(geometry, 1.0, -2.0, 0.5)
    truth = correct(equilibrium, force, 0 * x).displacement
    wrong = (x[:, :1] / 2) ** 2 * np.array([0.6, -0.8, 0.0])
    sizes = np.array([2e-3, 1e-3, 5e-4])[:, None, None]
    found = certify(equilibrium, np.stack([force] * 3), truth + sizes * wrong)
    own = np.abs(found.error - sizes * wrong).max(axis=(1, 2))
    assert found.settled.all()
    assert own[:-1] / own[1:] == pytest.approx([8, 8], rel=0.1)


def test_no_pressure_is_the_dead_load() -> None:
    geometry = body("quad")
    equilibrium = Equilibrium(geometry, MATERIAL)
    assert equilibrium.under(pressed(geometry, 0.0)).following is None
