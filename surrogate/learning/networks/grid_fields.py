"""Fields on the grid as a network sees them: channels of its inputs, values at some points.

Inputs are forces, and gradients of the response of the body to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Literal

from torch import Tensor

Input = Literal["force", "linear_gradient", "last_gradient"]


def channels_of(inputs: Sequence[Input], dimension: int) -> dict[Input, slice]:
    """Return the channels of every input, in order: d of a force, d² of a gradient."""
    channels: dict[Input, slice] = {}
    start = 0
    for name in inputs:
        stop = start + (dimension if name == "force" else dimension**2)
        channels[name] = slice(start, stop)
        start = stop
    return channels


def at_points(grid: Tensor, points: Tensor) -> Tensor:
    """Return the values at some points of grids: (N, d, nx, ny[, nz]) → (N, d · n_points)."""
    return grid.flatten(2).index_select(2, points).flatten(1)


def on_grid(values: Tensor, points: Tensor, like: Tensor) -> Tensor:
    """Place values (N, d · n_points) on grids like others, with zeros elsewhere."""
    fields = values.reshape(values.shape[0], like.shape[1], points.shape[0])
    grid = fields.new_zeros(*fields.shape[:2], prod(like.shape[2:]))
    return grid.index_copy(2, points, fields).reshape(values.shape[0], *like.shape[1:])
