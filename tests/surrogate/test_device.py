"""Arithmetic on the CPU."""

from __future__ import annotations

import torch

from surrogate.device import flush_denormals


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
