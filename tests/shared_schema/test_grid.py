"""Grids: exact ones by their definition, embedded ones by hand, and their arrays in a shard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shared_schema.content_problems import grid_problems
from shared_schema.grid import Grid, grid_arrays, grid_of
from shared_schema.layout import Arrays
from shared_schema.shard import array_problems, read_shard, write_shard

Array = NDArray[np.float64]


def box(shape: Sequence[int], spacing: Sequence[float]) -> Array:
    """Nodes of a full grid in lexicographic order, x slowest."""
    axes = [np.arange(n) * h for n, h in zip(shape, spacing, strict=True)]
    return np.stack([x.ravel() for x in np.meshgrid(*axes, indexing="ij")], axis=1)


def l_shape() -> Array:
    """An arm of 12 × 3 cells below left, a block of 3 × 7 cells at its end, in metres.

    By hand: (13 · 4) + (4 · 8) - 4 shared nodes = 80, on 13 + 3 = 16 columns and 8 rows.
    """
    arm = [
        (x, y) for x in np.linspace(0, 4.8, 13).tolist() for y in np.linspace(0, 6 / 7, 4).tolist()
    ]
    block = [(x, y) for x in np.linspace(4.8, 6, 4).tolist() for y in np.linspace(0, 2, 8).tolist()]
    shared = [point for point in block if point[0] == 4.8 and point[1] < 6 / 7 + 1e-9]
    return np.array(arm + [point for point in block if point not in shared])


BODIES = {
    "2d": box((16, 4), (4 / 15, 1 / 3)),
    "3d": box((5, 4, 3), (0.1, 1 / 3, 7.0)),
    "l-shape": l_shape(),
}


@pytest.mark.parametrize(("shape", "spacing"), [((16, 4), (0.3, 0.7)), ((5, 4, 3), (0.1, 2, 3))])
def test_order_is_x_slowest(shape: tuple[int, ...], spacing: tuple[float, ...]) -> None:
    grid = Grid.from_coordinates(box(shape, spacing))
    assert grid.shape == shape
    assert grid.mask.all()
    # node (ix * ny + iy) * nz + iz stands at (ix, iy, iz)
    assert grid.node_at.ravel().tolist() == list(range(int(np.prod(shape))))


def test_order_by_hand() -> None:
    """Four nodes given anticlockwise from the lower left corner."""
    grid = Grid.from_coordinates(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]))
    assert grid.node_at.tolist() == [[0, 3], [1, 2]]


def test_l_shape() -> None:
    coordinates = l_shape()
    assert len(coordinates) == 80
    grid = Grid.from_coordinates(coordinates)
    assert grid.shape == (16, 8)
    assert grid.nodes == 80
    assert grid.mask[:12, :4].all()
    assert not grid.mask[:12, 4:].any()
    assert grid.mask[12:].all()


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("seed", [None, 0, 1])
def test_round_trip_is_exact(body: str, seed: int | None) -> None:
    """Nodal to grid and back, nodes in order or permuted; with leading axes and without."""
    coordinates = BODIES[body]
    if seed is not None:
        coordinates = np.random.default_rng(seed).permutation(coordinates)
    grid = Grid.from_coordinates(coordinates)
    fields = np.random.default_rng(2).normal(size=(2, 3, *coordinates.shape))
    laid = grid.to_grid(fields)
    assert laid.shape == (2, 3, coordinates.shape[1], *grid.shape)
    np.testing.assert_array_equal(grid.to_nodes(laid), fields)
    np.testing.assert_array_equal(grid.to_grid(fields[0, 0]), laid[0, 0])
    assert not laid[..., ~grid.mask].any()


@pytest.mark.parametrize("body", BODIES)
def test_grid_of_permuted_nodes_holds_ascending_coordinates(body: str) -> None:
    coordinates = np.random.default_rng(3).permutation(BODIES[body])
    grid = Grid.from_coordinates(coordinates)
    for axis, laid in enumerate(grid.to_grid(coordinates)):
        lines = np.unique(BODIES[body][:, axis].round(9))
        shape = [-1 if a == axis else 1 for a in range(laid.ndim)]
        expected = np.broadcast_to(lines.reshape(shape), grid.shape)
        np.testing.assert_allclose(laid[grid.mask], expected[grid.mask], atol=1e-9)


def test_rounding_errors_of_coordinates_make_no_lines() -> None:
    """Noise far below the tolerance of 1e-6 of the size, as mesh generators leave it."""
    coordinates = BODIES["2d"]
    noise = np.random.default_rng(4).uniform(-1e-9, 1e-9, coordinates.shape)
    grid = Grid.from_coordinates(coordinates + noise)
    np.testing.assert_array_equal(grid.node_at, Grid.from_coordinates(coordinates).node_at)


def test_scattered_nodes_are_refused() -> None:
    coordinates = np.random.default_rng(5).uniform(size=(30, 2))  # 30 × 30 lines for 30 nodes
    with pytest.raises(ValueError, match="no structured order"):
        Grid.from_coordinates(coordinates)


def test_two_nodes_at_one_point_are_refused() -> None:
    coordinates = np.concatenate((BODIES["2d"], BODIES["2d"][5:6]))
    with pytest.raises(ValueError, match="same grid point"):
        Grid.from_coordinates(coordinates)


# --- embedded: the unit square in two triangles, on a grid of 3 x 2 points --------------------

# nodes 0 (0,0), 1 (1,0), 2 (1,1), 3 (0,1); triangles 0 1 2 and 0 2 3
COORDINATES = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SOURCES = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 2], [0, 1, 2]]])
HALF = 0.5  # the points at x = 1/2 lie half way between two nodes
SOURCE_WEIGHTS = np.array(
    [[[1.0, 0, 0], [0, 0, 1]], [[HALF, HALF, 0], [0, HALF, HALF]], [[0, 1, 0], [0, 0, 1]]]
)
POINTS = np.array([[0, 1, 2, 3], [2, 3, 4, 5], [2, 3, 4, 5], [0, 1, 2, 3]])
POINT_WEIGHTS = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]])


def square() -> Grid:
    return Grid(SOURCES, SOURCE_WEIGHTS, POINTS, POINT_WEIGHTS)


def test_shape_of_an_embedded_grid() -> None:
    grid = square()
    assert grid.shape == (3, 2)
    assert grid.nodes == 4
    assert grid.mask.all()


def test_values_between_nodes() -> None:
    """u = 1, 2, 3, 4 at the nodes: 1.5 and 3.5 half way along the lower and the upper side."""
    grid = square()
    nodal = np.array([1.0, 2.0, 3.0, 4.0])[:, None]
    assert grid.to_grid(nodal)[0] == pytest.approx(np.array([[1, 4], [1.5, 3.5], [2, 3]]))
    assert grid.to_nodes(grid.to_grid(nodal)) == pytest.approx(nodal)


def test_forces_keep_work_and_resultant() -> None:
    """F·U = f·(B U) for any f and U, so that ΣF = Σf with U = 1."""
    grid = square()
    rng = np.random.default_rng(1)
    f, u = rng.normal(size=(7, 4, 2)), rng.normal(size=(7, 2, 3, 2))
    on_grid = grid.forces_to_grid(f)
    assert (on_grid * u).sum() == pytest.approx((f * grid.to_nodes(u)).sum())
    assert on_grid.sum(axis=(2, 3)) == pytest.approx(f.sum(axis=1))


def test_points_that_move_with_a_node() -> None:
    """Node 1: its own point, and the one half way to node 0."""
    grid = square()
    moved = grid.moved_by(np.array([False, True, False, False]))
    assert moved.tolist() == [[False, False], [True, False], [True, False]]


def test_what_has_no_value_is_zero() -> None:
    sources = SOURCES.copy()
    sources[1, 0] = -1
    weights = np.where(sources < 0, 0.0, SOURCE_WEIGHTS)
    grid = Grid(sources, weights, POINTS, POINT_WEIGHTS)
    assert grid.mask.tolist() == [[True, True], [False, True], [True, True]]
    assert grid.to_grid(np.ones((4, 1)))[0].tolist() == [[1, 1], [0, 1], [1, 1]]
    assert not grid.moved_by(np.ones(4, dtype=bool))[1, 0]


def test_precision_is_kept() -> None:
    grid = square()
    values = np.ones((2, 4, 2), dtype=np.float32)
    assert grid.to_grid(values).dtype == grid.forces_to_grid(values).dtype == np.float32
    assert grid.to_nodes(grid.to_grid(values)).dtype == np.float32


# --- both ---------------------------------------------------------------------------------------


def two_sources(grid: Grid) -> Grid:
    """The same operators with a second source of weight zero, which hides that they are exact."""
    weights = np.concatenate((grid.source_weights, 0 * grid.source_weights), axis=-1)
    return Grid(np.repeat(grid.sources, 2, axis=-1), weights, grid.points, grid.point_weights)


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_permutations_are_what_the_operators_give(
    body: str, precision: type[np.float32] | type[np.float64]
) -> None:
    """Plain indexing and weighted sums agree to the last bit; A and B are each other's inverse."""
    rng = np.random.default_rng(6)
    exact = Grid.from_coordinates(rng.permutation(BODIES[body]))
    general = two_sources(exact)
    assert exact.points_are_nodes
    assert not general.points_are_nodes
    nodal = rng.normal(size=(3, exact.nodes, len(exact.shape))).astype(precision)
    laid = exact.to_grid(nodal)
    assert np.array_equal(general.to_grid(nodal), laid)
    assert np.array_equal(exact.forces_to_grid(nodal), laid)
    assert np.array_equal(general.forces_to_grid(nodal), laid)
    assert np.array_equal(general.to_nodes(laid), exact.to_nodes(laid))
    chosen = rng.random(exact.nodes) > 0.5
    assert np.array_equal(general.moved_by(chosen), exact.moved_by(chosen))
    assert np.array_equal(exact.moved_by(chosen)[exact.mask], chosen[exact.node_at[exact.mask]])


def test_points_of_an_embedded_grid_are_no_nodes() -> None:
    assert not square().points_are_nodes
    with pytest.raises(ValueError, match="no nodes"):
        square().node_at  # noqa: B018


@pytest.mark.parametrize("node_at", [[[0, 0], [1, -1]], [[0, 2], [3, -1]], [[0, -2], [1, 2]]])
def test_a_node_that_stands_twice_or_nowhere_is_refused(node_at: list[list[int]]) -> None:
    with pytest.raises(ValueError, match="exactly once"):
        Grid.of_nodes(np.array(node_at))


def test_half_a_permutation_is_not_exact() -> None:
    """One weight of 1/2, or a node that takes its value from another one's grid point."""
    grid = Grid.from_coordinates(BODIES["2d"])
    halved = grid.point_weights.copy()
    halved[7] = 0.5
    assert not Grid(grid.sources, grid.source_weights, grid.points, halved).points_are_nodes
    other = grid.points.copy()
    other[7] = other[8]
    assert not Grid(grid.sources, grid.source_weights, other, grid.point_weights).points_are_nodes


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
