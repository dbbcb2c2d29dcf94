"""Stochastic passes through a network, each with independently drawn weights.

The weights of pass t are a pure function of the seed and t, whatever the device and the number of
passes done at once.

Weights and masks that are drawn belong to the call, not to the modules: every thread may draw
others, of the same network.

The members of a deep ensemble (Lakshminarayanan et al. 2017) differ by their initial weights. All
see the same batches, and the loss is the mean of their losses, so that each is trained as if it
were alone. The standard deviation over the members is taken as the epistemic uncertainty.

With Monte Carlo dropout, every pass drops other channels of the same network; the standard
deviation over the passes is taken as the epistemic uncertainty (Gal and Ghahramani 2016; whole
channels: Tompson et al. 2015).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn
from torch.nn import functional

from shared_schema.common.errors import InputError
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.runtime.device import PASS, stream

Sample = tuple[Tensor, ...]  # of one module, for all passes: (passes, …) each
Drawn = Mapping["Drawable", Sample]
_drawn: ContextVar[Drawn | None] = ContextVar("drawn", default=None)
DRAWN = 2**28  # weights drawn at once: a gigabyte
PART_OF_FREE_MEMORY = 0.25  # what they may take of a GPU's, if that is more
PASSES = 300  # of a prediction, as the paper's
MOST_PASSES, MOST_SEED = 10**6, 2**63 - 1


class ChannelDropout(nn.Module):
    """Sets channels to zero with probability p, and multiplies the others by 1 / (1 − p).

    In training every sample of a batch has its own mask. In evaluation nothing is dropped. With
    what is drawn (`drawn.using`), a batch consists of as many equal chunks as there were draws,
    each with one mask.

    Parameters
    ----------
    channels : int
    rate : float
        Probability p.
    """

    fixed: Sample | None = None

    def __init__(self, channels: int, rate: float) -> None:
        super().__init__()
        self.channels, self.rate = channels, rate

    def forward(self, x: Tensor) -> Tensor:
        """Mask: (N, channels, nx, ny[, nz]) → the same shape."""
        extra = (1,) * (x.ndim - 2)
        drawn = drawn_for(self)
        if drawn is not None:
            masks = drawn[0].to(x).reshape(-1, 1, self.channels, *extra)
            return (x.reshape(len(masks), -1, *x.shape[1:]) * masks).reshape(x.shape)
        if not self.training:
            return x
        return x * functional.dropout(x.new_ones(*x.shape[:2], *extra), self.rate)

    def draw(self, generators: Sequence[torch.Generator]) -> tuple[Tensor]:
        """Draw independent masks for evaluation, one for each generator of the CPU."""
        kept = [torch.rand(self.channels, generator=one) >= self.rate for one in generators]
        return (torch.stack(kept) / (1 - self.rate),)


@runtime_checkable
class Drawable(Protocol):
    """A module with random weights or masks.

    Attributes
    ----------
    fixed : tuple of Tensor, or None
        What is used in all calls, as the constants of an exported or compiled network.
    """

    fixed: Sample | None

    def draw(self, generators: Sequence[torch.Generator]) -> Sample:
        """Draw one sample for each generator; inside `using`, a batch has as many equal chunks."""


def drawables(network: nn.Module) -> list[Drawable]:
    """Stochastic modules of a network; an empty list for a network that is not stochastic."""
    return [module for module in network.modules() if isinstance(module, Drawable)]


@contextmanager
def using(drawn: Drawn) -> Iterator[None]:
    """Enter a context, of this thread, in which modules use what is drawn for them."""
    token = _drawn.set(drawn)
    try:
        yield
    finally:
        _drawn.reset(token)


def drawn_for(module: Drawable) -> Sample | None:
    """Return what a module uses in place of random weights or means; None outside of `using`."""
    if module.fixed is not None or torch.compiler.is_dynamo_compiling():
        return module.fixed
    drawn = _drawn.get()
    return None if drawn is None else drawn.get(module)


class Ensemble(nn.Module):
    """K networks side by side; their outputs are joined to a batch K times as long.

    Parameters
    ----------
    members : iterable of nn.Module
        Networks with the same inputs and outputs.
    """

    def __init__(self, members: Iterable[nn.Module]) -> None:
        super().__init__()
        self.members = nn.ModuleList(members)

    def forward(self, x: Tensor) -> Tensor:
        """Evaluate one member after the other: (N, …) → (K·N, …)."""
        return torch.cat([member(x) for member in self.members])


def members_of(network: nn.Module) -> int:
    """Return the number of members of the ensemble in a network; 1 if there is none."""
    ensembles = (module for module in network.modules() if isinstance(module, Ensemble))
    return next((len(ensemble.members) for ensemble in ensembles), 1)


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
