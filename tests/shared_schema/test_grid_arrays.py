"""Arrays of an embedded grid: through a shard, and every violation named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from shared_schema.content_problems import grid_problems
from shared_schema.grid import Grid, grid_arrays, grid_of
from shared_schema.layout import Arrays
from shared_schema.shard import array_problems, read_shard, write_shard
from tests.shared_schema.test_grid import COORDINATES, SOURCE_WEIGHTS, square


@pytest.fixture
def arrays() -> Arrays:
    grid = square()
    nodal = np.random.default_rng(0).normal(size=(5, 4, 2))
    force = np.zeros((5, 4, 2))
    force[:, 2] = 1.5, -0.5
    return {
        "mesh/coordinates": COORDINATES,
        "mesh/cells": np.array([[0, 1, 2], [0, 2, 3]]),
        "mesh/clamped": np.array([True, False, False, True]),
        "mesh/loadable": np.array([False, False, True, False]),
        **grid_arrays(grid),
        "samples/number": np.arange(5),
        "samples/is_test": np.zeros(5, dtype=bool),
        "samples/force": grid.forces_to_grid(force).astype(np.float32),
        "samples/displacement": grid.to_grid(nodal).astype(np.float32),
        "samples/loaded_nodes": np.full((5, 1), 2),
        "samples/nodal_force": force[:, 2:3].astype(np.float32),
        "samples/nodal_displacement": nodal.astype(np.float32),
    }


def test_through_a_shard(arrays: Arrays, tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, "structured", arrays, "0" * 64, "triangle")
    read = read_shard(path, "structured")
    assert read.keys() == arrays.keys()
    assert all(np.array_equal(read[name], arrays[name]) for name in arrays)
    grid = grid_of(read)
    assert not grid.points_are_nodes
    assert np.array_equal(grid.source_weights, SOURCE_WEIGHTS)
    assert grid_problems(read, (3, 2)) == []


def put(name: str, index: tuple[int, ...], value: float) -> Callable[[Arrays], None]:
    def change(arrays: Arrays) -> None:
        arrays[name] = arrays[name].copy()
        arrays[name][index] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("grid/sources", (0, 0, 1), 4), "'grid/sources' names one outside 0 … 3"),
        (put("grid/points", (0, 0), 6), "'grid/points' names one outside 0 … 5"),
        (put("grid/source_weights", (1, 0, 0), 0.4), "'grid/source_weights' has rows"),
        (put("grid/point_weights", (1, 0), 0.1), "'grid/point_weights' has rows"),
        (put("grid/mask", (2, 1), 0), "'grid/mask' is not that"),
    ],
)
def test_what_is_wrong_is_named(
    arrays: Arrays, change: Callable[[Arrays], None], words: str
) -> None:
    assert grid_problems(arrays, (3, 2)) == []
    change(arrays)
    assert any(words in problem for problem in grid_problems(arrays, (3, 2)))


def test_another_shape_than_the_manifest_says(arrays: Arrays) -> None:
    assert "the manifest says (2, 2)" in grid_problems(arrays, (2, 2))[0]


def test_half_an_embedding_is_no_layout(arrays: Arrays, tmp_path: Path) -> None:
    del arrays["grid/points"]
    assert "dataset 'grid/points' is missing" in array_problems("structured", arrays, {})
    with pytest.raises(ValueError, match="grid/points"):
        write_shard(tmp_path / "shard-00000.h5", "structured", arrays, "0" * 64, "triangle")


def test_exact_grid_is_written_by_its_nodes() -> None:
    node_at = np.array([[2, 0], [1, -1]])
    arrays = grid_arrays(Grid.of_nodes(node_at))
    assert arrays.keys() == {"grid/node_at", "grid/mask"}
    assert arrays["grid/node_at"].tolist() == node_at.tolist()
    assert arrays["grid/mask"].tolist() == [[True, True], [True, False]]
    assert grid_of(arrays).node_at.tolist() == node_at.tolist()
    assert grid_of(arrays).points_are_nodes
