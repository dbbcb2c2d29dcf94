"""The two kinds of grid that a dataset can have, and their arrays in a shard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.embedded_grid import EmbeddedGrid
from shared_schema.grid_map import GridMap
from shared_schema.layout import Arrays

Grid = GridMap | EmbeddedGrid


def grid_arrays(grid: Grid) -> Arrays:
    """The maps between nodes and grid points, by the schema's paths of a structured shard."""
    if isinstance(grid, GridMap):
        return {"grid/node_at": grid.node_at, "grid/mask": grid.mask}
    return {
        "grid/sources": grid.sources,
        "grid/source_weights": grid.source_weights,
        "grid/points": grid.points,
        "grid/point_weights": grid.point_weights,
        "grid/mask": grid.mask,
    }


def grid_of(arrays: Arrays) -> Grid:
    """The grid whose arrays are these (`grid_arrays`)."""
    if "grid/node_at" in arrays:
        return GridMap(arrays["grid/node_at"])
    return EmbeddedGrid(
        arrays["grid/sources"],
        arrays["grid/source_weights"],
        arrays["grid/points"],
        arrays["grid/point_weights"],
    )


def grid_problems(arrays: Arrays, shape: tuple[int, ...]) -> list[str]:
    """What is wrong with the grid of a structured shard, whose array shapes are right.

    Parameters
    ----------
    arrays : mapping of str to array
    shape : tuple of int
        The grid's, as the manifest says.
    """
    grid = grid_of(arrays)
    if grid.shape != shape:
        name = "grid/node_at" if isinstance(grid, GridMap) else "grid/sources"
        return [f"dataset '{name}' has shape {grid.shape}, the manifest says {shape}"]
    nodes = len(arrays["mesh/coordinates"])
    problems = []
    if isinstance(grid, GridMap):
        if not np.array_equal(np.sort(grid.node_at[grid.mask]), np.arange(nodes)):
            problems.append("dataset 'grid/node_at' does not place every node exactly once")
    else:
        problems += _embedding_problems(grid, nodes)
    if not np.array_equal(grid.mask, arrays["grid/mask"]):
        problems.append("dataset 'grid/mask' is not that of the map from nodes to grid")
    for name in ("samples/force", "samples/displacement"):
        if np.any(arrays[name][..., ~grid.mask]):
            problems.append(f"dataset '{name}' is not zero where the grid has no value")
    return problems


def _embedding_problems(grid: EmbeddedGrid, nodes: int) -> list[str]:
    """Numbers out of range, and interpolations that do not reproduce a constant."""
    problems = []
    points = int(np.prod(grid.shape))
    for name, values, lowest, count in (
        ("sources", grid.sources[grid.mask], 0, nodes),
        ("points", grid.points, 0, points),
    ):
        if values.size and (values.min() < lowest or values.max() >= count):
            problems.append(f"dataset 'grid/{name}' names one outside 0 … {count - 1}")
    for name, weights in (
        ("source_weights", grid.source_weights[grid.mask]),
        ("point_weights", grid.point_weights),
    ):
        if not _sums_to_one(weights):
            problems.append(f"dataset 'grid/{name}' has rows that do not sum to 1")
    return problems


def _sums_to_one(weights: NDArray[np.float64]) -> bool:
    return bool(np.allclose(weights.sum(axis=-1), 1.0, rtol=0, atol=1e-9))
