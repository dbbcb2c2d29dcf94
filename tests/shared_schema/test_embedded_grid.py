"""An embedded grid by hand: the unit square in two triangles, on a grid of 3 x 2 points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from shared_schema.embedded_grid import EmbeddedGrid
from shared_schema.grid import grid_arrays, grid_of, grid_problems
from shared_schema.layout import Arrays
from shared_schema.shard_problems import array_problems
from shared_schema.shard_reader import read_shard
from shared_schema.shard_writer import write_shard

# nodes 0 (0,0), 1 (1,0), 2 (1,1), 3 (0,1); triangles 0 1 2 and 0 2 3
COORDINATES = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SOURCES = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 1, 2]]])
HALF = 0.5  # the points at x = 1/2 lie half way between two nodes
SOURCE_WEIGHTS = np.array(
    [[[1.0, 0, 0], [0, 0, 1]], [[HALF, HALF, 0], [0, HALF, HALF]], [[0, 1, 0], [0, 0, 1]]]
)
POINTS = np.array([[0, 1, 2, 3], [2, 3, 4, 5], [2, 3, 4, 5], [0, 1, 2, 3]])
POINT_WEIGHTS = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]])


@pytest.fixture
def grid() -> EmbeddedGrid:
    return EmbeddedGrid(SOURCES, SOURCE_WEIGHTS, POINTS, POINT_WEIGHTS)


@pytest.fixture
def arrays(grid: EmbeddedGrid) -> Arrays:
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


def test_shape(grid: EmbeddedGrid) -> None:
    assert grid.shape == (3, 2)
    assert grid.nodes == 4
    assert grid.mask.all()


def test_values_between_nodes(grid: EmbeddedGrid) -> None:
    """u = 1, 2, 3, 4 at the nodes: 1.5 and 3.5 half way along the lower and the upper side."""
    nodal = np.array([1.0, 2.0, 3.0, 4.0])[:, None]
    assert grid.to_grid(nodal)[0] == pytest.approx(np.array([[1, 4], [1.5, 3.5], [2, 3]]))
    assert grid.to_nodes(grid.to_grid(nodal)) == pytest.approx(nodal)


def test_forces_keep_work_and_resultant(grid: EmbeddedGrid) -> None:
    """F·U = f·(B U) for any f and U, so that ΣF = Σf with U = 1."""
    rng = np.random.default_rng(1)
    f, u = rng.normal(size=(7, 4, 2)), rng.normal(size=(7, 2, 3, 2))
    on_grid = grid.forces_to_grid(f)
    assert (on_grid * u).sum() == pytest.approx((f * grid.to_nodes(u)).sum())
    assert on_grid.sum(axis=(2, 3)) == pytest.approx(f.sum(axis=1))


def test_points_that_move_with_a_node(grid: EmbeddedGrid) -> None:
    """Node 1: its own point, and the one half way to node 0."""
    moved = grid.moved_by(np.array([False, True, False, False]))
    assert moved.tolist() == [[False, False], [True, False], [True, False]]


def test_what_has_no_value_is_zero() -> None:
    sources = SOURCES.copy()
    sources[1, 0] = -1
    weights = np.where(sources < 0, 0.0, SOURCE_WEIGHTS)
    grid = EmbeddedGrid(sources, weights, POINTS, POINT_WEIGHTS)
    assert grid.mask.tolist() == [[True, True], [False, True], [True, True]]
    assert grid.to_grid(np.ones((4, 1)))[0].tolist() == [[1, 1], [0, 1], [1, 1]]
    assert not grid.moved_by(np.ones(4, dtype=bool))[1, 0]


def test_precision_is_kept(grid: EmbeddedGrid) -> None:
    values = np.ones((2, 4, 2), dtype=np.float32)
    assert grid.to_grid(values).dtype == grid.forces_to_grid(values).dtype == np.float32
    assert grid.to_nodes(grid.to_grid(values)).dtype == np.float32


def test_through_a_shard(arrays: Arrays, tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, "structured", arrays, "0" * 64, "triangle")
    read = read_shard(path, "structured")
    assert read.keys() == arrays.keys()
    assert all(np.array_equal(read[name], arrays[name]) for name in arrays)
    grid = grid_of(read)
    assert isinstance(grid, EmbeddedGrid)
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
