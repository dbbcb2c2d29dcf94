"""Controllers of a body of another stiffness than their model's: followed, limited, safe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.actuation import drifting_body
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.actuation.controller import ControlFrame, Controller
from surrogate.mechanics.actuation.drifting_body import DriftingBody
from surrogate.mechanics.actuation.seen_state import Estimate
from surrogate.mechanics.identification.markers import Markers
from tests.surrogate.mechanics.actuation.test_actuation import GIVEN, fitted, tip
from tests.surrogate.mechanics.statics.test_cables import pulled

Array = NDArray[np.float64]
SOFTER = 0.8  # the body beside its model
FAST = {"along": 1000.0, "anchored": 1000.0}


class Plant:
    """Finite elements in place of a body that is softer than its model, and a camera."""

    def __init__(self, model: Actuation) -> None:
        self.model, geometry = model, model.body.geometry
        self.at_rest = geometry.coordinates[geometry.surface_nodes[::4]]
        self._at = Markers(self.at_rest, self.at_rest).interpolation(geometry)
        self.place, self.tip = tip(model.body)
        self.load: list[str] = []

    def controller(self, **options: Any) -> Controller:
        return Controller(
            self.model, markers=self.at_rest, target=self.place, noise=1e-4, **options
        )

    def displacement(self, given: dict[str, float]) -> Array:
        stiffer = {name: value / SOFTER for name, value in given.items()}
        load = [f"{place}:0,{float(f) / SOFTER}" for place, f in (t.split(":") for t in self.load)]
        return self.model.confirmed(self.model.at(stiffer, load), load).displacement

    def seen(self, given: dict[str, float]) -> Array:
        return np.asarray(self.at_rest + self._at @ self.displacement(given))

    def missed(self, given: dict[str, float], target: Array) -> float:
        x = self.model.body.geometry.coordinates[self.tip]
        return float(np.linalg.norm(x + self.displacement(given)[self.tip] - target))

    def goal(self, given: dict[str, float]) -> Array:
        x = self.model.body.geometry.coordinates[self.tip]
        return np.asarray(x + self.displacement(given)[self.tip])

    def led(self, controller: Controller, target: Array, frames: int) -> ControlFrame:
        for _ in range(frames):
            frame = controller.step(self.seen(controller.given), target)
        return frame


@pytest.fixture(scope="module")
def plant() -> Plant:
    return Plant(fitted(pulled("quad", "linear")))


def test_a_target_is_reached_with_the_wrong_stiffness(plant: Plant) -> None:
    """The tensions are those that reach it, and the stiffness is found."""
    target = plant.goal({"along": 9.0, "anchored": 3.0})
    controller = plant.controller(rates=FAST)
    frame = plant.led(controller, target, 8)
    assert plant.missed(frame.given, target) < 1e-4 * plant.model.size
    assert frame.given["along"] == pytest.approx(9, rel=0.01)
    assert frame.given["anchored"] == pytest.approx(3, rel=0.01)
    assert frame.stiffness == pytest.approx(SOFTER, rel=0.01)
    assert frame.warning == ""


def test_a_linear_body_is_there_after_one_frame() -> None:
    """Of a linear body with exact markers, the parameters are those of least squares, at once."""
    rng = np.random.default_rng(0)
    slopes, truth = rng.normal(size=(12, 3)), np.array([0.2, -1.0, 0.5])
    known = Estimate.of(np.ones(3)).seen(slopes, slopes @ truth, 1e-8)
    np.testing.assert_allclose(known.values, truth, atol=1e-12)
    np.testing.assert_allclose(known.later(100.0).covariance, np.eye(3), atol=1e-12)


def test_slopes_of_a_drifting_body_are_derivatives(plant: Plant) -> None:
    """By tensions, stiffness and a load, by central differences of equilibria."""
    body, parameters = DriftingBody(plant.model, ["2,0:0,-0.5"]), np.array([-0.2, 0.7])
    both, h = np.array([9.0, 3.0, *parameters]), 1e-3

    def at(change: Array) -> Array:
        return body.at((both + change)[:2], (both + change)[2:]).state

    expected = [(at(h * e) - at(-h * e)) / (2 * h) for e in np.eye(4)]
    state = body.at(both[:2], parameters)
    again, *slopes = body.followed(both[:2], parameters, state)
    np.testing.assert_allclose(again.state, state.state, atol=1e-9)
    found = np.concatenate(slopes)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_slopes_after_a_large_step_are_those_of_the_equilibrium(
    plant: Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A state turned along a straight line is stretched: its own tangent is too stiff."""
    body, parameters = DriftingBody(plant.model, []), np.zeros(1)
    before, after = np.array([0.0, 0.0]), np.array([12.0, 0.0])
    rest = body.at(before, parameters)
    _, by_given, _ = body.followed(before, parameters, rest)
    ahead = rest._replace(state=rest.state + (after - before) @ by_given)
    expected = body.followed(after, parameters, body.at(after, parameters))[1]

    def missed() -> float:
        found = body.followed(after, parameters, ahead)[1]
        return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))

    assert missed() < 1e-3
    monkeypatch.setattr(drifting_body, "FREED", np.inf)
    monkeypatch.setattr(drifting_body, "LONG", np.inf)
    assert missed() > 0.02


def test_a_state_ahead_turns_with_the_body(plant: Plant) -> None:
    """What a straight line misses of the state after a large step, polynomials know."""
    body, parameters = DriftingBody(plant.model, []), np.array([-0.2])
    before, after = np.array([1.0, 1.0]), np.array([8.0, 2.0])
    last, expected = (body.at(values, parameters) for values in (before, after))
    change = (after - before) @ body.followed(before, parameters, last)[1]
    ahead = body.ahead(after, parameters, last, change)
    far = np.linalg.norm(last.state + change - expected.state)
    assert np.linalg.norm(ahead.state - expected.state) < 0.1 * far


def test_a_payload_that_nobody_told_is_held(plant: Plant) -> None:
    """The tip comes back to its target; a load that may act there is told from the markers."""
    target = plant.goal({"along": 9.0, "anchored": 5.0})
    controller = plant.controller(rates=FAST, loads=[f"{plant.place}:0,-1"])
    plant.led(controller, target, 6)
    try:
        plant.load = [f"{plant.place}:-0.8"]
        assert plant.missed(controller.given, target) > 0.01 * plant.model.size
        frame = plant.led(controller, target, 8)
        assert plant.missed(frame.given, target) < 2e-3 * plant.model.size
        assert frame.loads[0] == pytest.approx(0.8, rel=0.05)
    finally:
        plant.load = []


def test_limits_and_rates_are_kept(plant: Plant) -> None:
    """Every frame changes what is given by its rate at most, and a far target is said to be far."""
    rates, within = {"along": 100.0, "anchored": 50.0}, {"along": (0.0, 8.0)}
    controller = plant.controller(rates=rates, within=within)
    target = plant.goal({"along": 9.0, "anchored": 3.0}) + np.array([0.0, 1.0])
    before, said = controller.given, []
    for _ in range(14):
        frame = controller.step(plant.seen(controller.given), target)
        for name, value in frame.given.items():
            assert abs(value - before[name]) <= 0.01 * rates[name] + 1e-12
        assert 0 <= frame.given["along"] <= 8
        before = frame.given
        said.append(frame.warning)
    assert frame.given["along"] == pytest.approx(8)
    assert said[0] == said[-1] == "the target is out of reach of the actuators"


def test_what_a_sensor_does_not_see_changes_nothing(plant: Plant) -> None:
    """Without markers the last actuations stay; some are enough; a wild one is none."""
    target = plant.goal({"along": 9.0, "anchored": 3.0})
    controller = plant.controller(rates=FAST)
    given = plant.led(controller, target, 3).given
    for blind in (None, np.full(plant.at_rest.shape, np.nan)):
        frame = controller.step(blind, target)
        assert frame.given == given
        assert frame.warning == "no marker is seen: the last actuations stay"
        assert frame.unseen == len(plant.at_rest)
    for _ in range(6):
        seen = plant.seen(controller.given)
        seen[0], seen[1, 0], seen[2] = np.nan, np.inf, 1e9
        frame = controller.step(seen, target)
    assert (frame.unseen, frame.warning) == (3, "")
    assert plant.missed(frame.given, target) < 5e-4 * plant.model.size


def test_a_model_without_equilibrium_keeps_the_last_actuations(
    plant: Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = plant.controller(rates=FAST)
    target = plant.goal(GIVEN)
    given = plant.led(controller, target, 2).given
    seen = plant.seen(given)
    with monkeypatch.context() as patched:

        def none(*_: Any) -> None:
            raise WorkError("none")

        patched.setattr(DriftingBody, "followed", none)
        frame = controller.step(seen, target)
    assert frame.given == given
    assert "no equilibrium" in frame.warning
    assert plant.led(controller, target, 1).warning == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rates": {"up": 1.0}}, "rates 'up'"),
        ({"rates": {"along": 0.0}}, "above 0"),
        ({"within": {"along": (2.0, 1.0)}}, "LOW < HIGH"),
        ({"period": 0.0}, "period 0.0: expected a number above 0"),
        ({"loads": ["nowhere:1,0"]}, "nowhere"),
    ],
)
def test_wrong_options_are_refused(plant: Plant, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        plant.controller(**options)


def test_wrong_frames_are_refused(plant: Plant) -> None:
    controller = plant.controller()
    for measured, target, said in [
        (plant.at_rest[1:], (1.0, 1.0), "measured has shape"),
        (plant.at_rest, (1.0, 1.0, 1.0), "target"),
        (plant.at_rest, (1.0, np.nan), "target"),
    ]:
        with pytest.raises(InputError, match=said):
            controller.step(measured, target)
    frame = controller.step(plant.at_rest, plant.model.body.geometry.coordinates[plant.tip])
    assert replace(frame, given={}).missed < 1e-9
