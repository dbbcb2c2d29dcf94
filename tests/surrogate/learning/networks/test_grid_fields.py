"""Channels of the inputs of a network, values at some points of a grid, and back."""

from __future__ import annotations

import torch

from surrogate.learning.networks.field_network import at_points, channels_of, on_grid


def test_there_and_back() -> None:
    """Component by component; other points are zero."""
    grid = torch.arange(12.0).reshape(1, 2, 2, 3)
    points = torch.tensor([1, 5])
    values = at_points(grid, points)
    assert values.tolist() == [[1, 5, 7, 11]]
    back = on_grid(values, points, grid)
    assert torch.equal(at_points(back, points), values)
    assert back.flatten(2)[..., [0, 2, 3, 4]].abs().sum() == 0


def test_channels_are_in_the_order_of_the_inputs() -> None:
    assert channels_of(["force"], 3) == {"force": slice(0, 3)}
    found = channels_of(["linear_gradient", "force", "last_gradient"], 2)
    assert list(found) == ["linear_gradient", "force", "last_gradient"]
    assert list(found.values()) == [slice(0, 4), slice(4, 6), slice(6, 10)]
