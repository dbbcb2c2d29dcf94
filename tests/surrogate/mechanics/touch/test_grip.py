"""Places that are held, and the forces that hold them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.common.errors import InputError, WorkError
from surrogate.command_line import main
from surrogate.mechanics.touch.condition import Held
from surrogate.mechanics.touch.grip import TOLERANCE
from surrogate.mechanics.touch.loaded_body import LinearBody
from surrogate.mechanics.touch.search import ForceSearch, Shown

Array = NDArray[np.float64]

PLACE, CORNERS = "4,1", ["4,1", "4,0"]  # at the end of a beam of 4 × 1 m


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def node_at(model: surrogate.Surrogate, *place: float) -> int:
    return int(np.linalg.norm(model.geometry.coordinates - place, axis=1).argmin())


def test_forces_that_move_a_place_are_found(beam: surrogate.Surrogate) -> None:
    """Those of which the displacement is taken; two places at once."""
    forces = np.zeros(beam.geometry.coordinates.shape)
    nodes = [node_at(beam, 4, 1), node_at(beam, 4, 0)]
    forces[nodes] = (0.8, -1.5), (-0.4, 0.6)
    truth = beam.predict(forces)
    frame = surrogate.Grip(beam, CORNERS, tolerance=1e-5).move(truth[nodes])
    np.testing.assert_allclose(frame.reactions, forces[nodes], rtol=1e-3)
    np.testing.assert_array_equal(frame.reactions, frame.force[nodes])
    assert np.abs(frame.displacement - truth).max() < TOLERANCE * np.abs(truth).max()
    assert frame.predictions < 20


def test_frames_begin_where_the_last_one_has_ended(beam: surrogate.Surrogate) -> None:
    grip = surrogate.Grip(beam, [PLACE], tolerance=1e-5)
    path = np.stack([np.linspace(0, 0.05, 25), np.linspace(0, -0.6, 25)], axis=1)
    frames = [grip.move(u[None]) for u in path]
    alone = surrogate.Grip(beam, [PLACE], tolerance=1e-5).move(path[-1:])
    np.testing.assert_allclose(frames[-1].reactions, alone.reactions, rtol=1e-3)
    assert max(frame.predictions for frame in frames[2:]) <= 6
    assert not frames[0].displacement.any()
    held = ", ".join(f"{part:.4g}" for part in alone.reactions[0])
    assert str(alone).startswith(f"GripFrame(held by ({held}) N; largest displacement 6")


def test_free_components_bear_no_force(beam: surrogate.Surrogate) -> None:
    """Pushed down at a corner that slides; the same from texts and from a mapping."""
    solution = beam.solve(held={PLACE: (None, -0.3)}, certify="full")
    node = node_at(beam, 4, 1)
    assert solution.force[node, 0] == 0 > solution.force[node, 1]
    assert solution.displacement[node, 1] == pytest.approx(-0.3, rel=1e-4)
    assert solution.grips is not None
    np.testing.assert_array_equal(solution.grips, solution.force[[node]])
    assert solution.estimated_error is not None
    assert np.abs(solution.estimated_error).max() < 1e-4
    assert "held by (0, " in repr(solution)
    same = beam.solve(held=[f"{PLACE}:-,-0.3"])
    np.testing.assert_array_equal(same.displacement, solution.displacement)


def test_load_beside_a_grip(beam: surrogate.Surrogate) -> None:
    """A propped cantilever: the prop pushes up, and bears a part of the load."""
    solution = beam.solve("1.86667,1:0,-2", held={PLACE: (None, 0.0)}, body_force=(0, -0.2))
    assert solution.grips is not None
    prop = solution.grips[0, 1]
    assert 0.5 < prop < 2
    free = beam.solve("1.86667,1:0,-2", body_force=(0, -0.2))
    height = np.abs(free.displacement[node_at(beam, 4, 1), 1])
    assert np.abs(solution.displacement[node_at(beam, 4, 1), 1]) < TOLERANCE * height
    np.testing.assert_allclose(
        solution.force.sum(axis=0), free.force.sum(axis=0) + np.array([0, prop]), atol=1e-12
    )


@pytest.mark.parametrize("how", [{"correct": True}, {"tolerance": 1e-6}])
def test_what_is_shown_is_held(beam: surrogate.Surrogate, how: dict[str, Any]) -> None:
    """A corrected or driven state has the wanted displacement, and its own forces."""
    solution = beam.solve(held={PLACE: (0.0, -1.2)}, **how)
    node = node_at(beam, 4, 1)
    assert solution.displacement[node] == pytest.approx((0.0, -1.2), abs=1e-4)
    certificate = beam.certify(solution.force, solution.displacement)
    assert certificate.max_error < 1e-5


@pytest.mark.parametrize(("depth", "force"), [(5.0, 58.8511), (20.0, 638.933)])
def test_places_held_far_away_are_those_of_the_equilibrium(
    beam: surrogate.Surrogate, depth: float, force: float
) -> None:
    """Forces as `datagen solve beam2d --hold 4,1:-,-5` finds them; 225 N would be predicted."""
    solution = beam.solve(held={PLACE: (None, -depth)})
    assert solution.grips is not None
    assert solution.grips[0] == pytest.approx((0.0, -force), rel=1e-5)
    assert solution.displacement[node_at(beam, 4, 1), 1] == pytest.approx(-depth)
    assert solution.correction is not None


def test_frames_go_beyond_predictions_and_back(beam: surrogate.Surrogate) -> None:
    """From 3.6 m on their error is above a hundredth, and the frames are equilibria."""
    slides = [f"{PLACE}:-,0"]
    grip, found = surrogate.Grip(beam, slides), {}
    for depth in (3.0, 3.4, 3.8, 4.2, 3.8, 3.4, 3.0):
        found[depth] = grip.move([(0.0, -depth)])
        exact = surrogate.Grip(beam, slides).correct([(0.0, -depth)])
        np.testing.assert_allclose(found[depth].reactions, exact.reactions, rtol=0.01)
    assert [depth for depth in found if found[depth].correction is not None] == [3.8, 4.2]


def test_far_displacement_is_applied_in_steps() -> None:
    """One whose forces the first steps overshoot."""
    model = surrogate.load("lshape2d_any")
    rng, limit = np.random.default_rng(1), model.description.data.info.force.max_abs
    nodes = np.flatnonzero(model.geometry.loadable & ~model.geometry.clamped)
    forces = np.zeros(model.geometry.coordinates.shape)
    node = rng.choice(nodes, 1, replace=False)
    forces[node] = rng.uniform(-np.array(limit), limit, (1, 2))
    moved = model.predict(forces)[node]
    place = ",".join(map(repr, map(float, model.geometry.coordinates[node[0]])))
    frame = surrogate.Grip(model, [place], tolerance=1e-5).move(moved)
    assert frame.correction is None
    np.testing.assert_allclose(frame.displacement[node], moved, rtol=1e-4)
    np.testing.assert_allclose(frame.reactions, forces[node], rtol=1e-2)


def test_first_step_follows_the_parabola_of_the_last_frames(beam: surrogate.Surrogate) -> None:
    """Of a body whose displacement is a parabola of its forces, three frames tell the next ones.

    The way back is the same parabola. Without it, each frame takes two predictions.
    """

    def softening(force: Any) -> Any:
        linear = beam.body.equilibrium.linear_response(force[None])[0]
        return linear * (1 + np.abs(linear).max())

    grip, path = surrogate.Grip(beam, [f"{PLACE}:-,0"]), -np.linspace(0.0, 0.6, 31)[1:]
    frames = [grip.move([(0.0, y)], predict=softening) for y in np.append(path, path[-2:-8:-1])]
    assert np.mean([frame.predictions for frame in frames[3:]]) < 1.3
    np.testing.assert_allclose(frames[-1].reactions, frames[23].reactions, rtol=1e-3)


def test_search_that_finds_nothing_says_how_far_it_came() -> None:
    """No force moves a body farther than 1 m; then a nearer target is found all the same."""
    springs: Any = SimpleNamespace(
        nodes=2,
        free=np.ones((2, 1), dtype=bool),
        forces_at_points=lambda f: f,
        linear_response=lambda f: f,
    )

    def shown(force: Array) -> Shown:
        return Shown(np.tanh(force), np.tanh(force), force)

    body = LinearBody(springs, np.arange(2))
    search = ForceSearch(body, shown, shown(np.zeros(2)))
    with pytest.raises(WorkError, match=r"no forces are found beyond \d+% of the way"):
        search.find(Held(np.array([2.0, 0.0])), TOLERANCE)
    body.forget()
    search = ForceSearch(body, shown, shown(np.zeros(2)))
    search.find(Held(np.array([0.5, -0.9])), 1e-5)
    np.testing.assert_allclose(np.tanh(search.shown.force), [0.5, -0.9], atol=1e-5)


@pytest.mark.parametrize(
    ("held", "said"),
    [
        ({}, "held: no place"),
        (["0,0:1,1"], "the node is clamped"),
        (["4,0.9:1,1"], "no node stands there"),
        (["tip:1,1"], "the groups of the mesh are none"),
        (["4,1:1"], "expected 2 numbers"),
        (["4,1:nan,0"], "expected finite numbers"),
        (["4,1:-,-"], "a displacement of one component at least"),
        (["4,1:1,0", "4,1:-,0"], "held or moved already"),
    ],
)
def test_wrong_grips(beam: surrogate.Surrogate, held: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        beam.solve(held=held)
    assert said in str(error.value)


def test_wrong_frames_and_loads(beam: surrogate.Surrogate) -> None:
    grip = surrogate.Grip(beam, [PLACE])
    for wrong in ([(0.0, np.nan)], [(0.0, 0.0, 0.0)], [(0.0, 0.0)] * 2):
        with pytest.raises(InputError, match="expected 1 of 2 finite numbers in m"):
            grip.move(wrong)
    with pytest.raises(InputError, match="tolerance"):
        surrogate.Grip(beam, [PLACE], tolerance=0.0)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "held.npz"
    words = ["predict", "beam2d_any", "--hold", "4.01,1:-,-0.3", "--nearest", "--out", str(path)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "acts at the nearest node, 4,1" in said
    with np.load(path) as fields:
        force = fields["force"]
    assert f"4.01,1:-,-0.3: held by 0,{force[:, 1].sum():.6g} N" in said
