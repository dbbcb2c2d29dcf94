"""Weights and masks that are drawn for a call.

They belong to the call, not to the modules: every thread may draw others, of the same network.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor, nn

Sample = tuple[Tensor, ...]  # of one module, for all passes: (passes, …) each
Drawn = Mapping["Drawable", Sample]

_drawn: ContextVar[Drawn | None] = ContextVar("drawn", default=None)


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
