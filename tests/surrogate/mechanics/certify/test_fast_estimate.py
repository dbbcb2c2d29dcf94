"""Estimates without a factorisation, against Newton's step and other formulas of the same terms."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.certify.full_certificate import certify
from surrogate.mechanics.descent import DrivenBody, carried_compliance
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load
from tests.surrogate.mechanics.equilibrium.test_following_loads import KINDS, pressed
from tests.surrogate.mechanics.equilibrium.test_following_loads import body as under_pressure


@pytest.mark.parametrize("kind", KINDS)
def test_estimate_under_pressure(kind: str) -> None:
    """It is that of Newton's step to a tenth; under forces of the pressure at rest it is not."""
    body = under_pressure(kind)
    pressure = pressed(body, 9.0)
    equilibrium = Equilibrium(body, MATERIAL)
    x, force = body.coordinates, end_load(body, *(1.0, -2.0, 0.5)[: body.dimension])
    truth = correct(equilibrium.under(pressure), force, 0 * x).displacement
    wrong = 1e-3 * (x[:, :1] / 2) ** 2 * np.array([0.6, -0.8, 0.3])[: body.dimension]
    predicted, fast = (truth + wrong)[None], FastEstimate(DrivenBody.of(equilibrium))
    found, _, softest = fast.with_stability(force[None], predicted, pressure)
    assert softest[0] > 0.05
    full = certify(equilibrium.under(pressure), force[None], predicted).error
    size = np.linalg.norm(full)
    assert np.linalg.norm(found - full) < 0.1 * size
    as_dead = fast(force[None] + pressure.at_rest, predicted)
    assert np.linalg.norm(as_dead - full) > 5 * size


def test_newtons_step_at_rest() -> None:
    """There K(u) = K(0) and T = 1: the first step is Newton's own, but for a difference's error."""
    body = box("hexahedron")
    equilibrium = Equilibrium(body, MATERIAL)
    force = end_load(body, 1.0, -2.0, 0.5)[None]
    found = FastEstimate(DrivenBody.of(equilibrium))(force, np.zeros_like(force))
    expected = equilibrium.linear_response(force)
    np.testing.assert_allclose(-found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
@pytest.mark.parametrize("large", [False, True])
def test_error_of_a_turned_body(
    cell_type: str, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end moves by 0.29 m of 2 m; the compliance at rest alone misses sevenfold."""
    monkeypatch.setattr(carried_compliance, "LARGE", 0 if large else 4000)
    body = box(cell_type)
    equilibrium = Equilibrium(body, MATERIAL)
    x = body.coordinates
    end = x[:, 0] == 2
    force = np.zeros_like(x)
    force[end, 1] = -5 / end.sum()
    truth = correct(equilibrium, force, np.zeros_like(force)).displacement
    assert np.abs(truth).max() == pytest.approx(0.29, abs=0.01)
    wrong = 1e-3 * (x[:, :1] / 2) ** 2 * np.array([0.6, -0.8, 0.3])[: body.dimension]
    predicted = (truth + wrong)[None]
    found = FastEstimate(DrivenBody.of(equilibrium))(force[None], predicted)[0]
    at_rest = equilibrium.linear_response(equilibrium.out_of_balance(predicted, force[None]))[0]
    assert np.abs(found - wrong).max() < 0.1 * np.abs(wrong).max()
    assert np.abs(at_rest - wrong).max() > 7 * np.abs(wrong).max()


def test_loads_one_by_one_and_moved_supports() -> None:
    body = box("quad")
    equilibrium = Equilibrium(body, MATERIAL)
    fast = FastEstimate(DrivenBody.of(equilibrium))
    rng = np.random.default_rng(0)
    force = end_load(body, 1.0, 1.0) * rng.uniform(-3, 3, (5, 1, 2))
    u = 1e-3 * rng.normal(size=force.shape)
    together = fast(force, u)
    np.testing.assert_array_equal(fast(force[3:4], u[3:4]), together[3:4])
    np.testing.assert_array_equal(together[:, body.clamped], u[:, body.clamped])
