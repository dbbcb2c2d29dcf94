"""Load families: pure functions of seed and sample number, in range, balanced."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.loads import LoadableNodes, load_family

PLACE = LoadableNodes(
    nodes=np.array([4, 7, 9, 12]),
    coordinates=np.random.default_rng(0).uniform(size=(20, 2)),
    cells=np.arange(20).reshape(5, 4),
    cell_type="quad",
)
RANDOM_NODE = {"family": "random_node", "region": {"y": 1}, "range": [-2.5, 2.5]}


def test_a_load_depends_on_seed_and_number_alone() -> None:
    family = load_family(RANDOM_NODE)
    forward = [family.draw(i, 7, PLACE) for i in range(20)]
    backward = [family.draw(i, 7, PLACE) for i in reversed(range(20))][::-1]
    for one, other in zip(forward, backward, strict=True):
        assert np.array_equal(one.forces, other.forces)
        assert np.array_equal(one.nodes, other.nodes)
    assert not np.array_equal(forward[0].forces, family.draw(0, 8, PLACE).forces)
    assert len({tuple(load.forces[0]) for load in forward}) == 20


def test_balanced_nodes_are_loaded_equally_often() -> None:
    family = load_family(RANDOM_NODE)
    loaded = [int(family.draw(i, 0, PLACE).nodes[0]) for i in range(400)]
    assert np.unique(loaded, return_counts=True)[1].tolist() == [100, 100, 100, 100]


def test_unbalanced_nodes_are_drawn() -> None:
    """400 draws of 4 nodes: each within 5 standard deviations (8.7) of 100."""
    family = load_family(RANDOM_NODE | {"balanced": False})
    loaded = [int(family.draw(i, 0, PLACE).nodes[0]) for i in range(400)]
    counts = np.unique(loaded, return_counts=True)[1]
    assert counts.tolist() != [100] * 4
    assert np.all(np.abs(counts - 100) < 44)


def test_force_components_are_uniform() -> None:
    """U(−2.5, 2.5): mean 0, standard deviation 2.5/√3, within 5 standard errors of 4000 draws."""
    family = load_family(RANDOM_NODE)
    forces = np.array([family.draw(i, 1, PLACE).forces[0] for i in range(2000)])
    assert np.abs(forces).max() <= 2.5
    assert abs(forces.mean()) < 5 * 2.5 / np.sqrt(3 * 4000)
    assert forces.std() == pytest.approx(2.5 / np.sqrt(3), rel=0.03)
    assert abs(np.corrcoef(forces.T)[0, 1]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"family": "wind"}, "load family 'wind'"),
        ({"family": "missing.py:Wind"}, "own classes are read with a case file only"),
        ({"family": "shared_schema.loads.regions:Region"}, "expected one of random_node"),
        ({"family_sha256": "0" * 64}, "load family 'random_node' is no file"),
        ({"family": 3}, "expected 'family'"),
        ({"range": [2.5, -2.5]}, "low < high"),
        ({"magnitude": 3}, "unknown key 'magnitude'"),
        ({"region": {"y": "high"}}, "a comparison"),
    ],
)
def test_invalid_families(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        load_family(RANDOM_NODE | change)
