r"""Exponential moving average of a network's weights.

.. math:: \bar w_t = \frac{\sum_{i=1}^t d^{t-i} w_i}{\sum_{i=1}^t d^{t-i}}
   = \bar w_{t-1} + \frac{1 - d}{1 - d^t} (w_t - \bar w_{t-1})

with the decay d: corrected for its start as Adam's moments are (Kingma and Ba 2015), so that the
initial weights have no part in it.
"""

from __future__ import annotations

import copy
from itertools import chain

import torch
from torch import nn


class WeightAverage:
    """Average over the steps of a training.

    Parameters
    ----------
    network : nn.Module
        The one in training.
    decay : float
        d.

    Attributes
    ----------
    network : nn.Module
        A copy with the averages of all weights and of batch norm's statistics; whole numbers are
        the latest.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).requires_grad_(False)
        self.decay = decay
        pairs = list(
            zip(
                chain(self.network.parameters(), self.network.buffers()),
                chain(network.parameters(), network.buffers()),
                strict=True,
            )
        )
        real = [(average, latest) for average, latest in pairs if average.is_floating_point()]
        self._averages = [average for average, _ in real]
        self._latest = [latest for _, latest in real]
        self._whole = [pair for pair in pairs if not pair[0].is_floating_point()]

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Take in the weights that a step (0, 1, …) has led to."""
        share = (1 - self.decay) / (1 - self.decay ** (step + 1))
        torch._foreach_lerp_(self._averages, self._latest, share)
        for average, latest in self._whole:
            average.copy_(latest)
