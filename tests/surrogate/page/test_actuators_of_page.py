"""The page finds what actuators do, and which of them reach a target, as Python does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.actuation.bordered import Balanced, balanced, moved_by
from surrogate.mechanics.statics.body import Body
from surrogate.page.page_actuators import sliders
from tests.surrogate.mechanics.statics.test_cables import pulled
from tests.surrogate.page.actuated import chambered
from tests.surrogate.page.page_in_node import PageInNode

BODIES: dict[str, tuple[Callable[[], Body], tuple[float, float]]] = {
    "cables": (lambda: pulled("tetra", "incompressible"), (12.0, 4.0)),
    "pressure and tension": (chambered, (100.0, 30.0)),
    "volume and length": (lambda: chambered(("volume", "length")), (1.3, 2.6)),
    "gas and slack cable": (lambda: chambered(("gas", "length")), (100.0, 3.5)),
}


@pytest.fixture(scope="module")
def ask(tmp_path_factory: pytest.TempPathFactory) -> PageInNode:
    return PageInNode(tmp_path_factory.mktemp("page"))


@pytest.mark.parametrize("name", BODIES)
def test_equilibria_and_derivatives(ask: PageInNode, name: str) -> None:
    """Beside a dead load; and from rest to what brings the tip to the same place."""
    make, values = BODIES[name]
    body: Body = make()
    model, equilibrium = Actuation.fit(body, samples=5), body.equilibrium
    force = np.zeros(equilibrium.free.shape)
    force[body.geometry.tip] = 0.5
    works = model.reduced.works_of(force)
    controls = model.controls_of(np.array(values))
    of = ActuatedModes(model.reduced, works)
    start = Balanced(np.zeros(len(works)), np.zeros(2))
    expected = balanced(of, controls, start, 1e-11)
    u, residual = model.reduced.displacement(expected.state), of.residual(*expected)
    assert residual is not None
    moved = np.tensordot(moved_by(of, controls, expected), model.reduced.modes, 1)
    tip, rest = body.geometry.tip, [control.at_rest for control in controls]
    asked = {"kind": "actuated", "force": force}
    found, back = ask(
        equilibrium,
        [
            {**asked, "given": values},
            {**asked, "force": 0 * force, "given": rest, "node": tip, "way": u[tip]},
        ],
        body.geometry.following,
        model,
    )
    assert found["reached"] == 1
    for name, exact in {
        "displacement": u,
        "amplitudes": expected.amplitudes,
        "quantities": residual.quantities,
        "changes": moved,
    }.items():
        close = np.array(found[name]).reshape(exact.shape)
        np.testing.assert_allclose(close, exact, rtol=0, atol=1e-5 * np.abs(exact).max())
    x = body.geometry.coordinates[tip]
    within = {each["name"]: (each["low"], each["high"]) for each in sliders(model)}
    reached = model.reach({",".join(map(str, x)): x + u[tip]}, within=within)
    units = np.abs(np.subtract(model.limits(within), rest)).max(axis=0)
    wanted = np.array(list(reached.given.values()))
    assert (np.abs(back["given"] - wanted) < 3e-2 * units).all()
    missed = np.array(back["displacement"]).reshape(u.shape)[tip] - u[tip]
    assert np.linalg.norm(missed) == pytest.approx(reached.missed, abs=1e-4)
