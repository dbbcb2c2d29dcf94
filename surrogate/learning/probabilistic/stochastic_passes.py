"""Stochastic passes through a network, each with independently drawn weights.

The weights of pass t are a pure function of the seed and t, whatever the device and the number of
passes done at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import nn

from shared_schema.common.errors import InputError
from surrogate.learning.probabilistic.drawn import Drawn, drawables, using
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.runtime.seeds import PASS, stream

DRAWN = 2**28  # weights drawn at once: a gigabyte
PART_OF_FREE_MEMORY = 0.25  # what they may take of a GPU's, if that is more
PASSES = 300  # of a prediction, as the paper's
MOST_PASSES, MOST_SEED = 10**6, 2**63 - 1


class Passes:
    """Passes of a network; those drawn last are kept, so that drawing them again costs nothing.

    Several threads may use them at once, each with passes of its own.

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
        self._last: tuple[int, range, Drawn] | None = None
        gaussian = [m.mean for m in network.modules() if isinstance(m, GaussianParameter)]
        weights = sum(mean.numel() for mean in gaussian)
        device = gaussian[0].device if gaussian else torch.device("cpu")
        self.at_once = max(1, most_weights(device) // max(weights, 1))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    @property
    def differ(self) -> bool:
        """True if passes differ, that is, if the network is stochastic."""
        return bool(self._modules)

    @contextmanager
    def drawn(self, seed: int, passes: range) -> Iterator[None]:
        """Enter a context in which the network takes a batch as equal chunks, one a pass.

        Only in this thread; outside, it takes a batch as a whole, by its means.
        """
        with using(self.draw(seed, passes)):
            yield

    @torch.inference_mode(False)
    @torch.no_grad()
    def draw(self, seed: int, passes: range) -> Drawn:
        """Draw the weights of passes of a seed, by module."""
        last = self._last
        if last is not None and last[:2] == (seed, passes):
            return last[2]
        self._last = last = None  # the old samples make room
        generators = [torch.Generator().manual_seed(stream(seed, PASS, t)) for t in passes]
        drawn = {module: module.draw(generators) for module in self._modules}
        self._last = seed, passes, drawn
        return drawn

    def fix(self, seed: int, passes: range) -> None:
        """Let the network use some passes in every call: for a file, or a compiled function."""
        for module, sample in self.draw(seed, passes).items():
            module.fixed = sample

    def forget(self) -> None:
        """Discard what was drawn last, and what `fix` has set."""
        self._last = None
        for module in self._modules:
            module.fixed = None


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
