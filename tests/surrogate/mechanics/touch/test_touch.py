"""Rigid tools that push a body: their forces, frames, and what is refused."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError, WorkError
from shared_schema.tools import Capsule, Mesh, Plane, Sphere, Tool
from surrogate.command_line import main
from surrogate.mechanics.touch.condition import solve_complementarity
from surrogate.mechanics.touch.loaded_body import LinearBody
from surrogate.mechanics.touch.touch import TOLERANCE
from tests.closed_surfaces import ball, surface_file

DISC = Sphere((3.0, 1.2), 0.3)  # 0.1 m into the upper face of a beam of 4 × 1 m
TOOLS = [
    DISC,
    Sphere((3.9, 1.1), 0.3),
    Capsule((2.0, 1.3), (4.0, 1.0), 0.1),
    Plane((4.0, 0.8), (-0.3, -1.0)),
]


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.mark.parametrize("seed", range(5))
def test_complementarity(seed: int) -> None:
    """The one of all sets of positive unknowns that fits, for a matrix that is not symmetric."""
    rng = np.random.default_rng(seed)
    root, turn = rng.normal(size=(2, 6, 6))
    matrix, offset = root @ root.T + 0.3 * (turn - turn.T) + np.eye(6), rng.normal(size=6)
    found = solve_complementarity(matrix, offset, rng.random(6) < 0.5)
    assert found is not None
    fits = []
    for chosen in product([False, True], repeat=6):
        part, trial = np.flatnonzero(chosen), np.zeros(6)
        trial[part] = np.linalg.solve(matrix[np.ix_(part, part)], -offset[part])
        if min(trial.min(), (matrix @ trial + offset).min()) > -1e-10:
            fits.append(trial)
    assert len(fits) == 1
    np.testing.assert_allclose(found, fits[0], atol=1e-10)


def test_problem_without_a_solution() -> None:
    assert solve_complementarity(np.array([[-1.0]]), np.array([-1.0]), np.array([False])) is None


def test_linear_body_learns(beam: surrogate.Surrogate) -> None:
    """Columns of K⁻¹ at rest; then the changes that it was told, symmetric and positive."""
    surface = beam.geometry.surface_nodes[~beam.geometry.clamped[beam.geometry.surface_nodes]]
    components = (2 * surface[:, None] + np.arange(2)).ravel()
    body, forces = LinearBody(beam.body.equilibrium, components), np.zeros(len(components))
    forces[[10, 11, 19]] = 0.1, -0.2, 0.3
    linear = beam.body.equilibrium.linear_response(body.load(forces[None]))[0].ravel()[components]
    np.testing.assert_allclose(body.moved(forces), linear, atol=1e-12)
    np.testing.assert_allclose(body.forces_for(linear), forces, atol=1e-9)
    for share in (0.5, 1.5):  # softer, then stiffer than at rest
        effect = linear * share * (1 + 0.2 * (1 - share))
        body.learn(forces * share, effect)
        np.testing.assert_allclose(body.moved(forces * share), effect, atol=1e-12)
        np.testing.assert_allclose(body.forces_for(effect), forces * share, atol=1e-9)
        everywhere = np.arange(len(components))
        matrix = body.compliance(everywhere, everywhere)
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
        assert np.linalg.eigvalsh(matrix).min() > 0


def test_frames_of_equal_moves_bend_alike(beam: surrogate.Surrogate) -> None:
    """Of a body whose displacement is a parabola of its forces, three frames tell the next ones."""

    def softening(force: Any) -> Any:
        linear = beam.body.equilibrium.linear_response(force[None])[0]
        return linear * (1 + np.abs(linear).max())

    touch = surrogate.Touch(beam)
    approach = [Sphere((3.5, 1.3 - 0.02 * number), 0.3) for number in range(1, 21)]
    frames = [touch.move(tool, predict=softening) for tool in approach]
    assert [frame.predictions for frame in frames[3:]] == [1] * 17  # 27 in all without a bend
    back = [touch.move(tool, predict=softening) for tool in approach[-2:-8:-1]]
    assert [frame.predictions for frame in back] == [1] * 6
    np.testing.assert_allclose(back[-1].reaction, frames[-7].reaction, rtol=2e-3)


def test_frame_after_one_of_another_prediction(beam: surrogate.Surrogate) -> None:
    """A frame shows what its own prediction shows, at the same forces too."""
    touch = surrogate.Touch(beam)
    softer = touch.move(DISC, predict=lambda force: 1.01 * beam.predict(force))
    frame = touch.move(DISC)
    expected = beam.predict(frame.force)
    assert np.abs(frame.displacement - expected).max() < 1e-9
    assert np.abs(softer.displacement - beam.predict(softer.force)).max() > 1e-4


def test_ball_of_triangles_is_a_sphere(tmp_path: Path) -> None:
    """In space: the same forces within the tilt of the triangles."""
    path = surface_file(tmp_path / "ball.stl", *ball(3000))
    body, place = surrogate.load("beam3d_any_reduced"), (3.0, 0.5, 1.2)
    frame = surrogate.Touch(body).move(Mesh(path, place, scale=0.29, rounding=0.01))
    expected = surrogate.Touch(body).move(Sphere(place, 0.3))
    size = np.linalg.norm(expected.reaction)
    assert np.linalg.norm(frame.reaction - expected.reaction) < 0.03 * size
    assert frame.penetration < 2 * TOLERANCE * np.abs(frame.displacement).max()


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: type(tool).__name__)
def test_contact(beam: surrogate.Surrogate, tool: Tool) -> None:
    """No node is inside, forces push out of the tool where there is no gap, and do what it does."""
    frame = surrogate.Touch(beam).move(tool)
    largest = np.abs(frame.displacement).max()
    assert max(frame.penetration, frame.apart) <= TOLERANCE * largest
    x, bears = beam.geometry.coordinates + frame.displacement, frame.force.any(axis=1)
    assert 1 <= frame.nodes == bears.sum()
    along = (frame.force * tool.normal(x)).sum(axis=1)
    np.testing.assert_allclose(along[bears], np.linalg.norm(frame.force[bears], axis=1), rtol=1e-3)
    np.testing.assert_array_equal(frame.displacement, beam.predict(frame.force))
    np.testing.assert_array_equal(frame.reaction, frame.force.sum(axis=0))


def test_frames(beam: surrogate.Surrogate) -> None:
    """A tool that presses, slides and lifts off; in between, the body is linear."""
    touch = surrogate.Touch(beam)
    for x in np.linspace(2.5, 3.0, 11):
        frame = touch.move(Sphere((x, 1.2), 0.3))
    alone = surrogate.Touch(beam).move(DISC)
    np.testing.assert_allclose(frame.reaction, alone.reaction, rtol=2e-3)
    assert frame.predictions <= 4
    assert str(frame).startswith(f"TouchFrame(tool: force {frame.reaction[0]:.6g},")
    said = str(beam.certify(frame.force, frame.displacement))
    assert said.startswith("Certificate(estimated error on this mesh ")
    near = Sphere((3.01, 1.195), 0.3)
    between = touch.reaction(near)
    np.testing.assert_allclose(between, touch.move(near).reaction, rtol=0.02, atol=0.01)
    assert np.linalg.norm(between - frame.reaction) > 0.02
    lifted = touch.move(Sphere((3.0, 2.0), 0.3))
    assert lifted.nodes == 0
    assert np.abs(lifted.displacement).max() < 1e-6


def test_a_load_that_would_carry_the_body_through_the_tool(beam: surrogate.Surrogate) -> None:
    """At once, the finite elements find what frames under a load that grows come to."""
    tool, load = Sphere((3.6, -0.35), 0.3), "4,1:0,-{}"
    at_once = surrogate.Touch(beam).move(tool, load.format(2))
    assert at_once.correction is not None
    touch = surrogate.Touch(beam)
    for force in np.linspace(0.2, 2, 10):
        touch.move(tool, load.format(force))
    exact = touch.correct(tool, load.format(2))
    np.testing.assert_allclose(at_once.reaction, exact.reaction, rtol=1e-6)


def test_solve(beam: surrogate.Surrogate) -> None:
    """A floor under a beam with a load, corrected: equilibrium, contact and certificate."""
    floor = Plane((0.0, -0.4), (0.0, 1.0))
    load, weight = "4,1:0,-2", (0, -0.1)
    solution = beam.solve(load, tool=floor, body_force=weight, correct=True, certify="full")
    contact = solution.contact
    assert contact is not None
    assert solution.estimated_error is not None
    assert np.abs(solution.estimated_error).max() < 1e-9
    lowest = (beam.geometry.coordinates + solution.displacement)[:, 1].min()
    assert lowest == pytest.approx(-0.4, abs=1e-4)
    free = beam.solve(load, body_force=weight)
    np.testing.assert_allclose(solution.force - contact.force, free.force, atol=1e-9)
    assert f"on {contact.nodes} node" in repr(solution)
    same = beam.solve(load, tool="plane:0,-0.4:0,1", body_force=weight, tolerance=1e-6)
    np.testing.assert_allclose(same.displacement, solution.displacement, atol=3e-4)


@pytest.mark.parametrize(
    ("tool", "said"),
    [
        (Sphere((0.0, 1.0), 0.5), "overlaps nodes that are held"),
        (Sphere((2.0, 0.5, 0.0), 0.1), "has points of 3 components, expected 2"),
        ("sphere:2,0.5", "expected one of sphere:X,Y[,Z]:R"),
    ],
)
def test_wrong_tools(beam: surrogate.Surrogate, tool: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        beam.solve(tool=tool)
    assert said in str(error.value)


def test_refusals(beam: surrogate.Surrogate) -> None:
    with pytest.raises(InputError, match=r"^tolerance -1: expected a positive number"):
        surrogate.Touch(beam, tolerance=-1)
    with pytest.raises(InputError, match="expected one of them"):
        beam.solve(tool=DISC, held={"4,1": (0, 0)})
    with pytest.raises(WorkError, match="inside the tool, expected one that comes from outside"):
        beam.solve(tool=Sphere((2.0, 0.5), 0.3))  # no node of the surface is in it
    with pytest.raises(WorkError, match="the tool is inside of the body, between its nodes"):
        beam.solve("4,1:0,-3", tool=Sphere((3.0, -0.25), 0.15))


def test_body_whose_case_has_pressures() -> None:
    """Tools and grips of a finger that may be inflated, and is not: driven by directions."""
    finger = surrogate.load("finger3d")
    x = finger.geometry.coordinates
    corner, tip = x[(x[:, 0] + x[:, 2]).argmax()], x[finger.geometry.tip]
    tool = Sphere((float(corner[0]), float(corner[1]), float(corner[2]) + 0.004), 0.005)
    pushed = finger.solve(tool=tool, tolerance=2e-3)
    assert pushed.descent is not None
    assert pushed.descent.reached
    assert pushed.contact is not None
    assert pushed.contact.penetration < 2e-6
    assert pushed.contact.reaction[2] < 0
    place = ",".join(map(repr, map(float, tip)))
    held = finger.solve(held={place: (None, None, -0.003)}, tolerance=2e-3)
    assert held.displacement[finger.geometry.tip, 2] == pytest.approx(-0.003, rel=1e-3)


def test_inflated_finger_touches_a_wall() -> None:
    """Beside a pressure that follows the surface, which grows from frame to frame.

    In the equilibrium with the contact, by ``--correct``, the wall bears 65.47 mN.
    """
    finger, wall = surrogate.load("finger3d"), Plane((0.0, 0.0, -0.01), (0.0, 0.0, 1.0))
    touch = surrogate.Touch(finger)
    for pressure in (600, 800, 1000):
        frame = touch.move(wall, f"notches:{pressure}")
    assert frame.correction is None
    assert frame.reaction == pytest.approx((0, 0, 0.06547), rel=0.02, abs=1e-6)
    assert touch.move(wall).nodes == 0


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "pushed.npz"
    assert main(["predict", "beam2d_any", "--tool", "sphere:3,1.2:0.3", "--out", str(path)]) == 0
    assert "N on 1 nodes, penetration" in capsys.readouterr().out
    with np.load(path) as found:
        assert found["force"][:, 1].sum() == pytest.approx(-0.595, rel=1e-2)
    assert main(["predict", "beam2d_any", "--tool", "cube:1", "--out", str(path)]) == 2
