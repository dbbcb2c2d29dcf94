"""Stochastic passes: every one through a network with weights of its own, drawn independently.

Pass t of a seed is a pure function of both, whatever the device and however many are done at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from torch import nn

from surrogate.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.seeds import PASS, stream

DRAWN = 2**28  # a gigabyte


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


class Passes:
    """The passes of a network; those last drawn stay, so that drawing them again costs nothing.

    Parameters
    ----------
    network : nn.Module

    Attributes
    ----------
    at_once : int
        As many passes as there is memory for, `DRAWN` weights.
    """

    def __init__(self, network: nn.Module) -> None:
        self._modules = drawables(network)
        self._drawn: tuple[int, range] | None = None
        gaussian = (m for m in network.modules() if isinstance(m, GaussianParameter))
        weights = sum(parameter.mean.numel() for parameter in gaussian)
        self.at_once = max(1, DRAWN // max(weights, 1))

    @property
    def differ(self) -> bool:
        """Whether passes differ: not in a network that is not stochastic."""
        return bool(self._modules)

    @torch.no_grad()
    def draw(self, seed: int, passes: range) -> None:
        """Make the network take its batch as equal parts, one for each of some passes of a seed."""
        if self._drawn == (seed, passes):
            return
        self.forget()  # the old samples make room
        generators = [torch.Generator().manual_seed(stream(seed, PASS, t)) for t in passes]
        for module in self._modules:
            module.draw(generators)
        self._drawn = seed, passes

    def forget(self) -> None:
        """Make the network take its batch as one part, by its mean weights."""
        for module in self._modules:
            module.forget()
        self._drawn = None
