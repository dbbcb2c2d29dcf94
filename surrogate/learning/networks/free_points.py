"""Values at some points of a grid, component by component, and back on the grid."""

from __future__ import annotations

from math import prod

from torch import Tensor


def at_points(grid: Tensor, points: Tensor) -> Tensor:
    """Return the values at some points of grids: (N, d, nx, ny[, nz]) → (N, d · n_points)."""
    return grid.flatten(2).index_select(2, points).flatten(1)


def on_grid(values: Tensor, points: Tensor, like: Tensor) -> Tensor:
    """Place values (N, d · n_points) on grids like others, with zeros elsewhere."""
    fields = values.reshape(values.shape[0], like.shape[1], points.shape[0])
    grid = fields.new_zeros(*fields.shape[:2], prod(like.shape[2:]))
    return grid.index_copy(2, points, fields).reshape(values.shape[0], *like.shape[1:])
