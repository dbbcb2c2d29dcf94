"""Stochastic passes through a network, each with independently drawn weights.

The weights of pass t are a pure function of the seed and t, whatever the device and the number of
passes done at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.seeds import PASS, stream

DRAWN = 2**28  # weights drawn at once: a gigabyte
PART_OF_FREE_MEMORY = 0.25  # what they may take of a GPU's, if that is more
PASSES = 300  # of a prediction, as the paper's
MOST_PASSES, MOST_SEED = 10**6, 2**63 - 1


@runtime_checkable
class Drawable(Protocol):
    """A module with random weights or masks, which `draw` fixes."""

    def draw(self, generators: Sequence[torch.Generator]) -> None:
        """Fix one sample for each generator; a batch then consists of as many equal chunks."""

    def forget(self) -> None:
        """Undo `draw`."""


def drawables(network: nn.Module) -> list[Drawable]:
    """Stochastic modules of a network; an empty list for a network that is not stochastic."""
    return [module for module in network.modules() if isinstance(module, Drawable)]


class Passes:
    """Passes of a network; the last drawn ones are kept, so that drawing them again costs nothing.

    Parameters
    ----------
    network : nn.Module

    Attributes
    ----------
    at_once : int
        Number of passes that fit into memory, with `most_weights` at most.
    """

    def __init__(self, network: nn.Module) -> None:
        self._modules = drawables(network)
        self._drawn: tuple[int, range] | None = None
        gaussian = [m.mean for m in network.modules() if isinstance(m, GaussianParameter)]
        weights = sum(mean.numel() for mean in gaussian)
        device = gaussian[0].device if gaussian else torch.device("cpu")
        self.at_once = max(1, most_weights(device) // max(weights, 1))

    @property
    def differ(self) -> bool:
        """True if passes differ, that is, if the network is stochastic."""
        return bool(self._modules)

    @torch.no_grad()
    def draw(self, seed: int, passes: range) -> None:
        """Draw passes of a seed; the network then takes a batch as equal chunks, one a pass."""
        if self._drawn == (seed, passes):
            return
        self.forget()  # the old samples make room
        generators = [torch.Generator().manual_seed(stream(seed, PASS, t)) for t in passes]
        for module in self._modules:
            module.draw(generators)
        self._drawn = seed, passes

    def forget(self) -> None:
        """Discard the drawn passes; the network then takes a batch as a whole, by its means."""
        for module in self._modules:
            module.forget()
        self._drawn = None


def most_weights(device: torch.device) -> int:
    """Return the largest number of weights drawn at once on a device."""
    if device.type != "cuda":
        return DRAWN
    free, _ = torch.cuda.mem_get_info(device)
    return max(DRAWN, int(PART_OF_FREE_MEMORY * free) // torch.float32.itemsize)


def require_passes(passes: int, seed: int) -> None:
    """Raise InputError unless number of passes and seed are in range."""
    for name, value, least, most in (
        ("passes", passes, 1, MOST_PASSES),
        ("seed", seed, 0, MOST_SEED),
    ):
        if not least <= value <= most:
            raise InputError(f"{name} = {value}, expected {least} at least and {most} at most")
