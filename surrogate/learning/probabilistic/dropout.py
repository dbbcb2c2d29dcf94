"""Monte Carlo dropout: channels are dropped at random in prediction as in training.

Every pass drops other channels of the same network; the standard deviation over the passes is taken
as the epistemic uncertainty (Gal and Ghahramani 2016; whole channels: Tompson et al. 2015).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from surrogate.learning.probabilistic.stochastic_passes import Sample, drawn_for


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
