"""Predictions that are corrected from frame to frame come to the finite elements' equilibrium."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.tools import Sphere
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.touch.defect_correction import DefectCorrection

Array = NDArray[np.float64]
TOO_FAR = 1.1  # what the wrong predictions are times too large
PLACE, DEPTH, FRAMES = "4,1", 0.2, 30


class WrongPredictions:
    """A body whose predictions are all too large."""

    has_series, knows_forces = False, True

    def __init__(self, model: surrogate.Surrogate) -> None:
        self.body, self._model = model.body, model

    def respond(self, loads: Load) -> tuple[Array, Array]:
        found, last = self._model.respond(loads)
        return TOO_FAR * found, last

    def predict(self, dead: Array) -> Array:
        return self.respond(Load(dead))[0]


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def disc(depth: float) -> Sphere:
    """A disc in the upper face of a beam of 4 × 1 m."""
    return Sphere((3.0, 1.3 - depth), 0.3)


def off(found: Array, truth: Array) -> float:
    """Distance over the largest displacement or force."""
    return float(np.abs(found - truth).max() / np.abs(truth).max())


def test_body_that_is_kept_still_comes_to_its_equilibrium(beam: surrogate.Surrogate) -> None:
    body, truth = WrongPredictions(beam), surrogate.Touch(beam).correct(disc(0.1))
    plain = surrogate.Touch(body, corrected=False).move(disc(0.1))
    assert off(plain.force, truth.force) > 0.05
    touch = surrogate.Touch(body)
    errors = [off(touch.move(disc(0.1)).force, truth.force) for _ in range(12)]
    assert errors[0] < 0.02
    assert errors[-1] < 2e-3
    assert off(touch.move(disc(0.1)).displacement, truth.displacement) < 2e-3


def test_frames_of_a_tool(beam: surrogate.Surrogate) -> None:
    """What is left is what changes in one frame, at no more predictions."""
    body, frames = WrongPredictions(beam), {}
    for corrected in (False, True):
        touch, predictions = surrogate.Touch(body, corrected=corrected), 0
        for depth in np.linspace(0, DEPTH, FRAMES + 1)[1:]:
            frames[corrected] = touch.move(disc(depth))
            predictions += frames[corrected].predictions
        assert predictions < 3 * FRAMES
    truth = surrogate.Touch(beam).correct(disc(DEPTH))
    assert off(frames[False].reaction, truth.reaction) > 0.05
    assert off(frames[True].reaction, truth.reaction) < 0.01
    largest = np.abs(truth.displacement).max()
    assert max(frames[True].penetration, frames[True].apart) < 1e-3 * largest


def test_frames_of_a_grip(beam: surrogate.Surrogate) -> None:
    grip, plain = (
        surrogate.Grip(WrongPredictions(beam), [PLACE], corrected=way) for way in (None, False)
    )
    for height in np.linspace(0, -0.6, FRAMES):
        frame, other = grip.move([(0.0, height)]), plain.move([(0.0, height)])
    truth = surrogate.Grip(beam, [PLACE]).correct([(0.0, -0.6)])
    assert off(other.reactions, truth.reactions) > 0.02
    assert off(frame.reactions, truth.reactions) < 2e-3
    assert off(frame.displacement, truth.displacement) < 2e-3


def test_shift_goes_on_as_errors_change(beam: surrogate.Surrogate) -> None:
    """Predictions of a softer body: their error grows, and is known from one frame to the next."""

    class Softer(WrongPredictions):
        def respond(self, loads: Load) -> tuple[Array, Array]:
            return self._model.respond(loads.part(TOO_FAR))

    heights = np.linspace(0, -0.33, FRAMES)
    grip, truth = surrogate.Grip(Softer(beam), [PLACE]), surrogate.Grip(beam, [PLACE])
    errors = [
        off(grip.move([(0.0, y)]).reactions, truth.correct([(0.0, y)]).reactions)
        for y in heights[1:]
    ]
    plain = surrogate.Grip(Softer(beam), [PLACE], corrected=False).move([(0.0, heights[-1])])
    assert off(plain.reactions, truth.correct([(0.0, heights[-1])]).reactions) > 0.05
    assert max(errors[5:]) < 1e-3  # the shift changes by more than that from frame to frame


def test_no_step_is_taken_where_it_would_change_little(beam: surrogate.Surrogate) -> None:
    """A small step, then one that is asked for by the forces, and by a body that stands still."""
    force = np.zeros(beam.geometry.coordinates.shape)
    force[-1] = (0.0, -0.5)

    def second(share: float, felt: float) -> Array:
        defect = DefectCorrection(WrongPredictions(beam))
        for part in (1.0, share):
            u = (1 + 1e-4) * beam.predict(part * force)
            step = defect.improve(u, part * force, lambda _: felt)
            assert part != 1.0 or step.any()
        return step

    assert not second(1.5, felt=1e-4).any()
    assert second(3.0, felt=1e-3).any()  # four times as much
    assert second(1.5, felt=1e-1).any()
    assert second(1.0, felt=1e-4).any()


def test_unloaded_body_is_at_rest(beam: surrogate.Surrogate) -> None:
    touch = surrogate.Touch(WrongPredictions(beam))
    for _ in range(3):
        assert touch.move(disc(0.1)).force.any()
    lifted = touch.move(disc(-0.5))
    assert not lifted.force.any()
    assert not lifted.displacement.any()


def test_load_series_and_own_predictions_are_not_corrected(beam: surrogate.Surrogate) -> None:
    touch = surrogate.Touch(beam)
    for _ in range(3):
        frame = touch.move(disc(0.1))
    np.testing.assert_array_equal(frame.displacement, beam.predict(frame.force))
    body = WrongPredictions(beam)
    touch = surrogate.Touch(body)
    for _ in range(3):
        frame = touch.move(disc(0.1), predict=body.predict)
    np.testing.assert_array_equal(frame.displacement, body.predict(frame.force))


def test_shift_that_does_not_help_is_given_up(beam: surrogate.Surrogate) -> None:
    """Where cells are inverted there is nothing to learn; the shift of before is taken back."""
    defect = DefectCorrection(WrongPredictions(beam))
    force = np.zeros(beam.geometry.coordinates.shape)
    force[-1] = (0.0, -1.0)
    shift = defect.improve(beam.predict(force) * TOO_FAR, force)
    assert shift.any()
    inverted = beam.geometry.coordinates * (-2.0, 0.0)
    assert beam.body.equilibrium.inverted(inverted[None])[0]
    np.testing.assert_array_equal(defect.improve(inverted, force), -shift)
    assert not defect.shift.any()


def test_steps_of_a_body_that_is_kept_still_do_not_grow(beam: surrogate.Surrogate) -> None:
    """However large the forces out of balance are."""
    defect = DefectCorrection(WrongPredictions(beam))
    force = np.zeros(beam.geometry.coordinates.shape)
    force[-1] = (0.0, -1.0)
    field = TOO_FAR * beam.predict(force)
    first, second = defect.improve(field, force), defect.improve(field, 100 * force)
    lengths = [np.linalg.norm(step, axis=1).max() for step in (first, second)]
    assert 0 < lengths[0] < 0.5 * np.abs(field).max()
    assert lengths[1] == pytest.approx(lengths[0])
