"""Tools and grips by the finite elements alone, also where their forces would not hold the body."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.tools import Plane, Sphere
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import MATERIAL, box

DISC, COLUMN = Sphere((3.0, 1.2), 0.3), Sphere((4.05, 0.5), 0.3)


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def imbalance(model: surrogate.Surrogate, u: np.ndarray, force: np.ndarray) -> float:
    """Largest force out of balance, over the largest force of a node."""
    r = model.body.equilibrium.out_of_balance(u[None], force[None])
    return float(np.abs(r).max() / np.abs(force).max())


@pytest.mark.parametrize("tool", [DISC, COLUMN, Plane((4.0, 0.8), (-0.3, -1.0))])
def test_equilibrium_with_a_tool(beam: surrogate.Surrogate, tool: Sphere | Plane) -> None:
    """Forces push out of the tool where there is no gap, nothing is inside, all is in balance."""
    frame = surrogate.Touch(beam).correct(tool)
    x, bears = beam.geometry.coordinates + frame.displacement, frame.force.any(axis=1)
    assert frame.correction is not None
    assert max(frame.penetration, frame.apart) < 1e-9
    along = (frame.force * tool.normal(x)).sum(axis=1)
    np.testing.assert_allclose(along[bears], np.linalg.norm(frame.force[bears], axis=1))
    assert imbalance(beam, frame.displacement, frame.force) < 1e-7


@pytest.mark.parametrize("mean_dilation", [False, True])
def test_points_between_the_nodes(mean_dilation: bool) -> None:
    """Quadratic triangles, and Taylor and Hood's: a plane against the end of a clamped box."""
    geometry = replace(box("triangle"), mean_dilation=mean_dilation)
    body = Equilibrium(geometry, MATERIAL, on_points=True)
    plane = Plane((1.8, 0.0), (-1.0, 0.0))
    of_body = SimpleNamespace(geometry=geometry, equilibrium=body, under=lambda _: body)
    model: Any = SimpleNamespace(body=of_body, has_series=True)
    found = surrogate.Touch(model).correct(plane)
    u = body.at_points(found.displacement[None], body.forces_at_points(found.force[None]))
    np.testing.assert_allclose((geometry.coordinates + found.displacement)[:, 0].max(), 1.8)
    r = body.out_of_balance(u, body.forces_at_points(found.force[None]))
    assert np.abs(r).max() < 1e-6 * np.abs(found.force).max()
    assert found.force.sum(axis=0)[0] < -20


def test_from_a_frame_and_from_rest(beam: surrogate.Surrogate) -> None:
    touch = surrogate.Touch(beam)
    alone = touch.correct(DISC)
    touch.let_go()
    predicted = touch.move(DISC)
    assert predicted.correction is None
    after = touch.correct(DISC)
    np.testing.assert_allclose(after.displacement, alone.displacement, atol=1e-8)
    np.testing.assert_allclose(after.force, alone.force, atol=1e-6)


def test_column_beyond_the_load_of_euler(beam: surrogate.Surrogate) -> None:
    """No dead forces hold it so; frames after it are found alike, and others are predicted."""
    touch = surrogate.Touch(beam)
    frame = touch.move(COLUMN)
    assert frame.correction is not None
    assert beam.body.equilibrium.response_at(frame.displacement) is None
    soon = touch.reaction(Sphere((4.04, 0.5), 0.3))
    further = touch.move(Sphere((4.04, 0.5), 0.3))
    np.testing.assert_allclose(soon, further.reaction, atol=0.02 * abs(further.reaction[0]))
    assert further.reaction[0] < frame.reaction[0] < -20
    assert touch.move(Sphere((6.0, 0.5), 0.3)).nodes == 0
    assert touch.move(Sphere((6.0, 0.5), 0.3)).correction is None
    solution = beam.solve(tool=COLUMN)
    assert solution.correction is not None
    np.testing.assert_allclose(solution.displacement, frame.displacement, atol=1e-8)


def test_equilibrium_with_grips(beam: surrogate.Surrogate) -> None:
    """Held exactly, in balance; the same forces are found by predictions."""
    places, wanted = ["4,1", "1.86667,0"], [(0.05, -0.6), (0.0, -0.2)]
    grip = surrogate.Grip(beam, places)
    frame = grip.correct(wanted)
    assert frame.correction is not None
    moved = frame.displacement[grip.components.any(axis=0)].reshape(2, 2)
    np.testing.assert_allclose(np.sort(moved, axis=0), np.sort(wanted, axis=0), atol=1e-15)
    assert imbalance(beam, frame.displacement, frame.force) < 1e-7
    predicted = surrogate.Grip(beam, places, tolerance=1e-5).move(wanted)
    np.testing.assert_allclose(predicted.reactions, frame.reactions, rtol=1e-3)


def test_a_grip_that_compresses_beyond_the_load_of_euler(beam: surrogate.Surrogate) -> None:
    grip = surrogate.Grip(beam, ["4,1", "4,0"])
    frame = grip.move([(-0.7, 0.0), (-0.7, 0.0)])
    assert frame.correction is not None
    assert frame.reactions[:, 0].sum() < -70
    assert beam.body.equilibrium.response_at(frame.displacement) is None
