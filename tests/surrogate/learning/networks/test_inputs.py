"""Channels of the inputs of a network."""

from __future__ import annotations

from surrogate.learning.networks.inputs import channels_of


def test_channels_are_in_the_order_of_the_inputs() -> None:
    assert channels_of(["force"], 3) == {"force": slice(0, 3)}
    found = channels_of(["linear_gradient", "force", "last_gradient"], 2)
    assert list(found) == ["linear_gradient", "force", "last_gradient"]
    assert list(found.values()) == [slice(0, 4), slice(4, 6), slice(6, 10)]
