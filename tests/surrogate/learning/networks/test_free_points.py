"""Values at some points of a grid, and back."""

from __future__ import annotations

import torch

from surrogate.learning.networks.free_points import at_points, on_grid


def test_there_and_back() -> None:
    """Component by component; other points are zero."""
    grid = torch.arange(12.0).reshape(1, 2, 2, 3)
    points = torch.tensor([1, 5])
    values = at_points(grid, points)
    assert values.tolist() == [[1, 5, 7, 11]]
    back = on_grid(values, points, grid)
    assert torch.equal(at_points(back, points), values)
    assert back.flatten(2)[..., [0, 2, 3, 4]].abs().sum() == 0
