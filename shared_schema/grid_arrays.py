"""The arrays of a grid in a structured shard: written, read, and held against their contract.

A grid whose points are the nodes has ``grid/node_at``; an embedded one has both operators, as
``grid/sources`` with ``grid/source_weights`` and ``grid/points`` with ``grid/point_weights``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE, Arrays


def grid_arrays(grid: Grid) -> Arrays:
    """Arrays of a grid, by the schema's paths of a structured shard."""
    if grid.points_are_nodes:
        return {"grid/node_at": grid.node_at, "grid/mask": grid.mask}
    return {
        "grid/sources": grid.sources,
        "grid/source_weights": grid.source_weights,
        "grid/points": grid.points,
        "grid/point_weights": grid.point_weights,
        "grid/mask": grid.mask,
    }


def grid_of(arrays: Arrays) -> Grid:
    """Make the grid that has these arrays (`grid_arrays`)."""
    if "grid/node_at" in arrays:
        return Grid.of_nodes(arrays["grid/node_at"])
    return Grid(
        arrays["grid/sources"],
        arrays["grid/source_weights"],
        arrays["grid/points"],
        arrays["grid/point_weights"],
    )


def grid_problems(arrays: Arrays, shape: tuple[int, ...]) -> list[str]:
    """List what is wrong with the grid of a structured shard whose array shapes are right.

    Parameters
    ----------
    arrays : mapping of str to array
    shape : tuple of int
        Shape of the grid in the manifest.
    """
    name = "grid/node_at" if "grid/node_at" in arrays else "grid/sources"
    node_at = arrays[name] if name == "grid/node_at" else arrays[name][..., 0]
    if node_at.shape != shape:
        return [f"dataset '{name}' has shape {node_at.shape}, the manifest says {shape}"]
    mask = node_at != NO_NODE
    problems = []
    if name == "grid/sources":
        problems += _embedding_problems(arrays, mask)
    elif not np.array_equal(np.sort(node_at[mask]), np.arange(len(arrays["mesh/coordinates"]))):
        problems.append(f"dataset '{name}' does not place every node exactly once")
    if not np.array_equal(mask, arrays["grid/mask"]):
        problems.append("dataset 'grid/mask' is not that of the map from nodes to grid")
    for field in ("samples/force", "samples/displacement"):
        if np.any(arrays[field][..., ~mask]):
            problems.append(f"dataset '{field}' is not zero where the grid has no value")
    return problems


def _embedding_problems(arrays: Arrays, mask: NDArray[np.bool_]) -> list[str]:
    """Name numbers out of range, and interpolations that do not reproduce a constant."""
    problems = []
    for name, numbers, count in (
        ("sources", arrays["grid/sources"][mask], len(arrays["mesh/coordinates"])),
        ("points", arrays["grid/points"], mask.size),
    ):
        if numbers.size and (numbers.min() < 0 or numbers.max() >= count):
            problems.append(f"dataset 'grid/{name}' names one outside 0 … {count - 1}")
    for name, weights in (
        ("source_weights", arrays["grid/source_weights"][mask]),
        ("point_weights", arrays["grid/point_weights"]),
    ):
        if not np.allclose(weights.sum(axis=-1), 1.0, rtol=0, atol=1e-9):
            problems.append(f"dataset 'grid/{name}' has rows that do not sum to 1")
    return problems
