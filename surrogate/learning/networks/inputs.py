"""Inputs of a network on the grid: forces, and gradients of the response of the body to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

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
