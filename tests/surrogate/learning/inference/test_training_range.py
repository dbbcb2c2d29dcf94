"""Warnings about forces unlike those of the training data: one loaded node, ±2.5 N."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

import surrogate
from shared_schema.grid import Grid
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.load_range import LoadRange, PressedNodes, known_families, load_range
from surrogate.learning.inference.training_range import TrainingRange, forces_to_grid
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.statics.load import given_load


@pytest.fixture
def model(trained: Path) -> surrogate.Surrogate:
    return surrogate.load(trained)


def test_loads_of_a_training(dataset: Dataset, trained: Path) -> None:
    """Every sample has one loaded node, so the resultant is its force."""
    found = load_range(dataset)
    assert (found.fewest, found.most) == (1, 1)
    assert found.resultant == pytest.approx(dataset.info.force.max_abs, rel=1e-6)
    assert RunFolder(trained).description().data.loads == found


def test_every_kind(model: surrogate.Surrogate, dataset: Dataset) -> None:
    """Node 31 at the upper right corner is loadable, node 28 below it is not."""
    limit = np.array(dataset.info.force.max_abs)
    exceeded = model.training_range.exceeded
    forces = np.zeros((32, 2))
    assert exceeded(forces) == {}
    forces[31] = limit
    assert exceeded(forces) == {}
    forces[31] = -1.01 * limit
    found = exceeded(forces)
    assert list(found) == ["range", "resultant"]
    assert f"±{limit[0]:.3g}" in found["range"]
    forces[31], forces[28] = 0.0, 0.5 * limit
    assert exceeded(forces) == {"places": "a loaded node was never loaded in the training data"}
    forces[:] = 0.0
    forces[[23, 27, 31]] = 0.2 * limit
    assert exceeded(forces) == {"number": "number of loaded nodes 3, 1 in the training data"}
    forces[[23, 27, 31]] = 0.4 * limit
    assert list(exceeded(forces)) == ["number", "resultant"]
    assert list(exceeded(np.stack([0 * forces, forces]))) == ["number", "resultant"]


def test_forces_that_add_up_beside_those_that_never_do() -> None:
    """Those of pressures in chambers have no resultant but rounding: it is said to be 0."""
    loads = LoadRange(fewest=4, most=12, resultant=(8e-16, 0.0))
    found = TrainingRange((1.0, 1.0), np.ones(12, dtype=bool), loads)
    closed = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)] * 3) / 2 + 1e-9
    assert found.exceeded(closed) == {}
    said = "the resultant is beyond that of the training data (0)"
    assert found.exceeded(closed + np.array([0.01, 0])) == {"resultant": said}


def test_one_node_on_a_network_of_tractions() -> None:
    loads = LoadRange(fewest=4, most=9, resultant=(1.0, 1.0))
    found = TrainingRange((1.0, 1.0), np.ones(12, dtype=bool), loads)
    assert found.exceeded(np.eye(12)[:, :1] * [0.5, 0.5]) == {
        "number": "number of loaded nodes 1, 4 to 9 in the training data"
    }


def test_a_pressure_and_a_single_force() -> None:
    """`finger3d` learned one force, and a pressure of 0 to 1500 Pa on its notches, 330 nodes.

    Each alone and both together are in range; a second force is not, nor is a pressure of 2000 Pa.
    """
    finger = surrogate.load("finger3d")
    coordinates, loadable = finger.geometry.coordinates, finger.geometry.loadable
    nodes = np.flatnonzero(loadable & ~finger.geometry.groups["notches"])[[3, 90]]
    on_notch = np.flatnonzero(loadable & finger.geometry.groups["notches"])[7]
    force = {
        node: f"{','.join(repr(float(x)) for x in coordinates[node])}:0.05,0.05,0.02"
        for node in (*nodes, on_notch)
    }

    def unusual(*loads: str) -> list[str]:
        given = given_load(finger.geometry, loads)
        return list(finger.training_range.exceeded(given.at_rest))

    assert unusual(force[nodes[0]]) == []
    assert unusual(force[on_notch]) == []
    assert unusual("notches:900") == []
    assert unusual("notches:900", force[nodes[0]]) == []
    assert unusual("notches:900", force[on_notch]) == []
    assert unusual("notches:2000") == ["resultant"]
    assert unusual(force[nodes[0]], force[nodes[1]]) == ["number"]
    assert unusual("notches:900", force[on_notch], force[nodes[1]]) == ["number"]
    assert finger.training_range.exceeded(
        given_load(finger.geometry, [force[nodes[0]], force[nodes[1]]]).at_rest
    ) == {"number": "number of nodes with other forces 2, 0 to 1 in the training data"}


def test_a_resultant_that_is_rounding_is_that_of_the_training() -> None:
    """The forces of a pressure on a closed surface add up to rounding errors, 1e-15 of their size.

    A tenth of one of them is no rounding error.
    """
    loads = LoadRange(fewest=4, most=4, resultant=(7.8e-16, 1e-16))
    found = TrainingRange((1.0, 0.0), np.ones(4, dtype=bool), loads)
    forces = np.array([[0.9, 1e-17], [-0.9, -1e-17], [0.5, 1e-16], [-0.5 + 5e-15, 1e-16]])
    assert found.exceeded(forces) == {}
    forces[0, 0] = 0.8
    assert list(found.exceeded(forces)) == ["resultant"]
    forces[0] = 0.9, 1e-3
    assert list(found.exceeded(forces)) == ["range", "resultant"]


def test_a_kind_of_load_that_the_training_had_none_of() -> None:
    """`finger3d` learned pressures and single forces; its own weight is another kind of load."""
    finger = surrogate.load("finger3d")
    solution = finger.solve(body_force=(0, 0, -9810))
    unlike = "a body force is a kind of load that the training data have none of"
    assert solution.outside_training == (f"{unlike} (pressure, random_nodes)",)
    assert finger.training_range.compared(solution.force, True) == solution.outside_training[0]


def test_body_force_on_a_network_of_pressures_is_no_question_of_units() -> None:
    """Nothing of a pressure of 1 Pa on two facets is like a weight of 1e-9 N a node."""
    pressed = PressedNodes(np.tile([0.0, 1.0], (3, 1)), 0.0)
    loads, nodes = LoadRange(fewest=3, most=3, resultant=(1.0, 3.0)), np.ones(3, dtype=bool)
    found = TrainingRange((1.0, 1.0), nodes, loads, pressed=pressed, families={"pressure"})
    weight = np.tile([1e-9, 0.0], (3, 1))
    only = "forces other than pressures, the only loads of the training data"
    assert found.exceeded(weight) == {"kind": only}
    assert found.exceeded(np.tile([0.0, 0.5], (3, 1))) == {}
    assert "units" in found.compared(weight)
    assert "units" not in found.compared(weight, body_force=True)


def test_families_that_may_draw_any_load_say_nothing_of_its_kind() -> None:
    pressure, given = {"family": "pressure"}, {"family": "given"}
    assert known_families({"load": pressure}) == {"pressure"}
    assert known_families({"load": [pressure, given]}) == frozenset()
    assert known_families({"load": {"family": "mine.py:Wind"}}) == frozenset()


def test_predict_warns_once_a_kind(model: surrogate.Surrogate) -> None:
    forces = np.zeros((32, 2))
    forces[31] = 0.0, 100.0
    with pytest.warns(surrogate.OutsideTrainingWarning) as caught:
        model.predict(np.stack([forces, forces]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.predict(forces)
    assert [str(warning.message).split(" ")[0] for warning in caught] == ["force", "the"]
    assert caught[0].filename == __file__
    forces[28], forces[31] = 1.0, 0.0
    with pytest.warns(surrogate.OutsideTrainingWarning, match="never loaded"):
        model.predict(forces)


def test_warnings_can_be_silenced(model: surrogate.Surrogate) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
        model.predict(np.where(model.geometry.clamped[:, None], 0.0, np.full((32, 2), 100.0)))


def test_run_without_loads_is_resumed_and_warns_of_the_rest(trained: Path, tmp_path: Path) -> None:
    """Runs made before `loads` lack the key."""
    run = RunFolder(trained)
    content = yaml.safe_load(run.config.read_text())
    del content["data"]["loads"]
    old = RunFolder(tmp_path)
    old.config.write_text(yaml.safe_dump(content))
    (tmp_path / run.model.name).write_bytes(run.model.read_bytes())
    old.require_free(run.description())
    forces = np.full((32, 2), 100.0)
    assert list(surrogate.load(tmp_path).training_range.exceeded(forces)) == ["range", "places"]


def test_range_on_an_embedded_grid_is_that_of_its_points() -> None:
    """A node halfway between two points: 2 N on it are 1 N on each, the largest of a training."""
    sources, weights = np.zeros((2, 2, 1), dtype=np.int64), np.ones((2, 2, 1))
    points = np.array([[0, 1], [2, 2]])
    grid = Grid(sources, weights, points, np.array([[0.5, 0.5], [1.0, 0.0]]))
    found = TrainingRange((1.0, 1.0), np.ones(2, dtype=bool), None, grid)
    assert found.exceeded(np.array([[2.0, 0.0], [0.0, -1.0]])) == {}
    assert list(found.exceeded(np.array([[2.1, 0.0], [0.0, 0.0]]))) == ["range"]
    assert list(found.exceeded(np.array([[0.0, 0.0], [0.0, -1.1]]))) == ["range"]
    both = np.array([[[2.0, 0.0], [0.0, -1.0]], [[0.0, 0.0], [0.0, -1.1]]])
    assert list(found.exceeded(both)) == ["range"]
    on_grid = grid.forces_to_grid(both).reshape(2, 2, 4).swapaxes(1, 2)
    np.testing.assert_allclose([forces_to_grid(grid) @ forces for forces in both], on_grid)
