"""Stochastic passes: every one through a network with weights of its own, drawn independently.

Pass t of a seed is a pure function of both, whatever the device and however many are done at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import torch
from torch import nn

from surrogate.seeds import PASS, stream


@runtime_checkable
class Drawable(Protocol):
    """A module whose output is random, until it is drawn."""

    def draw(self, generators: Sequence[torch.Generator]) -> None:
        """Take one fixed sample of the module a generator; a batch then has as many equal parts."""

    def forget(self) -> None:
        """Undo `draw`."""


def drawables(network: nn.Module) -> list[Drawable]:
    """Modules of a network that passes differ by; none in a network that is not stochastic."""
    return [module for module in network.modules() if isinstance(module, Drawable)]


@contextmanager
def drawn(network: nn.Module, seed: int, passes: Sequence[int]) -> Iterator[None]:
    """Make a network take its batch as equal parts, one for each of some passes of a seed."""
    modules = drawables(network)
    generators = [torch.Generator().manual_seed(stream(seed, PASS, number)) for number in passes]
    try:
        for module in modules:
            module.draw(generators)
        yield
    finally:
        for module in modules:
            module.forget()
