"""Arithmetic on the CPU."""

from __future__ import annotations

import numpy as np
import torch

from shared_schema.points_in_cells import PointTree
from surrogate.runtime.device import flush_denormals


def test_numbers_below_the_smallest_normal_one_are_zero() -> None:
    """Float32: the smallest normal number is 1.2e-38, the smallest of all 1.4e-45."""
    tiny = torch.full((8,), 2e-38)
    torch.set_flush_denormal(False)  # another test may have run a command
    try:
        assert (tiny * 0.5).all()
        flush_denormals()
        assert not (tiny * 0.5).any()
        assert tiny.all()
    finally:
        torch.set_flush_denormal(False)
    assert (tiny * 0.5).all()


def test_points_on_a_plane_through_0_are_found() -> None:
    """SciPy's own tree of these points splits without end where denormals are flushed."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 40), np.linspace(0.0, 1.0, 40))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    points = points[np.lexsort((points[:, 0] > 0, points[:, 1]))]
    flush_denormals()
    try:
        tree = PointTree(points)
    finally:
        torch.set_flush_denormal(False)
    distance, number = tree.query(points)
    assert number.tolist() == list(range(len(points)))
    assert distance.max() < 1e-15
    near = tree.query_ball_point(points[:1], np.array([0.03]))[0]
    assert (
        sorted(near) == np.flatnonzero(np.linalg.norm(points - points[0], axis=1) < 0.03).tolist()
    )
