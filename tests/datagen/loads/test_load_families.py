"""Each shipped load family against counts and integrals by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shared_schema.loads.distributed_forces import point_areas
from tests.datagen.loads.places import family, place


def test_random_nodes_differ_and_vary_in_number() -> None:
    top = place({"y": 1, "x": "> 0"})
    several = family("random_nodes", range=[-1, 1], count=[2, 3])
    several.check(top)
    counts = []
    for number in range(200):
        load = several.draw(number, 0, top)
        assert len(set(load.nodes)) == len(load.nodes)
        assert set(load.nodes) <= set(top.nodes)
        assert np.abs(load.forces).max() <= 1
        counts.append(len(load.nodes))
    assert set(counts) == {2, 3}
    assert several.loads_per_sample(top) == 3
    with pytest.raises(ValueError, match="the region has 4 nodes"):
        family("random_nodes", range=[-1, 1], count=[2, 9]).check(top)


def test_each_node_in_turn_from_the_top() -> None:
    """On the paper's free edge the first node is on the training line y = 1, the last at y = 0."""
    edge = place({"x": 4})
    each = family("each_node", force=[0, -1.5])
    heights = [float(edge.coordinates[each.draw(i, 0, edge).nodes[0], 1]) for i in range(4)]
    assert heights == pytest.approx([1.0, 0.5, 0.0, 1.0])
    assert each.draw(2, 0, edge).forces.tolist() == [[0.0, -1.5]]
    with pytest.raises(ValueError, match="expected 2 components"):
        family("each_node", force=[0, 0, 1]).check(edge)


def test_sweep() -> None:
    """−8 … 8 N in 5 steps: −8, −4, 0, 4, 8."""
    corner = place({"x": 4, "y": 1})
    sweep = family("sweep", direction=[0, 2], range=[-8, 8], steps=5)
    sweep.check(corner)
    assert [sweep.draw(i, 0, corner).forces[0, 1] for i in range(6)] == [-8, -4, 0, 4, 8, -8]
    assert not any(sweep.draw(i, 0, corner).forces[0, 0] for i in range(5))
    with pytest.raises(ValueError, match="one to sweep at"):
        sweep.check(place({"x": 4}))


def test_traction_on_an_edge() -> None:
    """Edge of length 1 in two elements: trapezoidal rule, 1/4, 1/2, 1/4."""
    edge = place({"x": 4})
    order = np.argsort(edge.coordinates[edge.nodes, 1])
    assert point_areas(edge)[edge.nodes][order] == pytest.approx([0.25, 0.5, 0.25])
    pull = family("traction", range=[-3, 3])
    load = pull.draw(0, 0, edge)
    total = load.forces.sum(axis=0)
    assert np.abs(total).max() <= 3
    assert load.forces == pytest.approx(np.outer(point_areas(edge)[edge.nodes], total))


def test_traction_on_a_face() -> None:
    """Face of 1 m² in 2 x 2 elements: corners 1/16, edges 1/8, centre 1/4."""
    face = place({"x": 4}, (4, 2, 2))
    assert np.sort(point_areas(face)[face.nodes]) == pytest.approx(
        [1 / 16] * 4 + [1 / 8] * 4 + [1 / 4]
    )


def test_traction_needs_facets() -> None:
    with pytest.raises(ValueError, match="belongs to no facet"):
        family("traction", range=[-1, 1]).check(place({"x": 4, "y": 1}))


@pytest.mark.parametrize(
    ("name", "keys", "said"),
    [
        ("random_nodes", {"range": [-1, 1], "count": [3, 2]}, "fewest <= most"),
        ("random_nodes", {"range": [1, 1]}, "low < high"),
        ("sweep", {"direction": [0, 0], "range": [-1, 1], "steps": 3}, "other than zero"),
        ("sweep", {"direction": [0, 1], "range": [-1, 1], "steps": 1}, "greater than 1"),
        ("each_node", {"force": [1]}, "at least 2"),
        ("traction", {"range": [2, 1]}, "low < high"),
    ],
)
def test_wrong_keys(name: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        family(name, **keys)
