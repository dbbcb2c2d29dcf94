from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from shared_schema.grid_map import GridMap

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
    grid = GridMap.from_coordinates(box(shape, spacing))
    assert grid.shape == shape
    assert grid.mask.all()
    # node (ix * ny + iy) * nz + iz stands at (ix, iy, iz)
    assert grid.node_at.ravel().tolist() == list(range(int(np.prod(shape))))


def test_order_by_hand() -> None:
    """Four nodes given anticlockwise from the lower left corner."""
    grid = GridMap.from_coordinates(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]))
    assert grid.node_at.tolist() == [[0, 3], [1, 2]]


def test_l_shape() -> None:
    coordinates = l_shape()
    assert len(coordinates) == 80
    grid = GridMap.from_coordinates(coordinates)
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
    grid = GridMap.from_coordinates(coordinates)
    fields = np.random.default_rng(2).normal(size=(2, 3, *coordinates.shape))
    laid = grid.to_grid(fields)
    assert laid.shape == (2, 3, coordinates.shape[1], *grid.shape)
    np.testing.assert_array_equal(grid.to_nodes(laid), fields)
    np.testing.assert_array_equal(grid.to_grid(fields[0, 0]), laid[0, 0])
    assert not laid[..., ~grid.mask].any()


@pytest.mark.parametrize("body", BODIES)
def test_grid_of_permuted_nodes_holds_ascending_coordinates(body: str) -> None:
    coordinates = np.random.default_rng(3).permutation(BODIES[body])
    grid = GridMap.from_coordinates(coordinates)
    for axis, laid in enumerate(grid.to_grid(coordinates)):
        lines = np.unique(BODIES[body][:, axis].round(9))
        shape = [-1 if a == axis else 1 for a in range(laid.ndim)]
        expected = np.broadcast_to(lines.reshape(shape), grid.shape)
        np.testing.assert_allclose(laid[grid.mask], expected[grid.mask], atol=1e-9)


def test_rounding_errors_of_coordinates_make_no_lines() -> None:
    """Noise far below the tolerance of 1e-6 of the size, as mesh generators leave it."""
    coordinates = BODIES["2d"]
    noise = np.random.default_rng(4).uniform(-1e-9, 1e-9, coordinates.shape)
    grid = GridMap.from_coordinates(coordinates + noise)
    np.testing.assert_array_equal(grid.node_at, GridMap.from_coordinates(coordinates).node_at)


def test_scattered_nodes_are_refused() -> None:
    coordinates = np.random.default_rng(5).uniform(size=(30, 2))  # 30 × 30 lines for 30 nodes
    with pytest.raises(ValueError, match="no structured order"):
        GridMap.from_coordinates(coordinates)


def test_two_nodes_at_one_point_are_refused() -> None:
    coordinates = np.concatenate((BODIES["2d"], BODIES["2d"][5:6]))
    with pytest.raises(ValueError, match="same grid point"):
        GridMap.from_coordinates(coordinates)
