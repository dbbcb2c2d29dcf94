r"""Exponential moving average of a network's weights.

.. math:: \bar w_t = \frac{\sum_{i=1}^t d^{t-i} w_i}{\sum_{i=1}^t d^{t-i}}
   = \bar w_{t-1} + \frac{1 - d}{1 - d^t} (w_t - \bar w_{t-1})

with the decay d. The bias of the start is corrected as for Adam's moments (Kingma and Ba 2015), so
that the average does not contain the initial weights.

`torch.optim.swa_utils.AveragedModel` is not used: it copies its count to the device and reads it
back in every step, so that the host waits for the GPU.
"""

from __future__ import annotations

from copy import deepcopy
from itertools import chain
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

Network = TypeVar("Network", bound=nn.Module)


class WeightAverage(Generic[Network]):
    """Average over the steps of a training.

    Parameters
    ----------
    network : nn.Module
        Network in training.
    decay : float
        Decay d.

    Attributes
    ----------
    module : nn.Module
        Copy of the network with averages of all weights and of batch norm's statistics. Integers,
        such as batch norm's counter, have their latest values.
    steps : int
        Number of averaged steps t.
    """

    def __init__(self, network: Network, decay: float) -> None:
        self.module = deepcopy(network).requires_grad_(False)
        self.decay = decay
        self.steps = 0

    @torch.no_grad()
    def update(self, network: Network) -> None:
        """Add the weights after a step."""
        self.steps += 1
        share = (1 - self.decay) / (1 - self.decay**self.steps)
        torch._foreach_lerp_(_tensors(self.module, True), _tensors(network, True), share)
        if counters := _tensors(self.module, False):
            torch._foreach_copy_(counters, _tensors(network, False))


def _tensors(network: nn.Module, floating: bool) -> list[Tensor]:
    """Return all parameters and buffers that are floating-point numbers, or that are not."""
    tensors = chain(network.parameters(), network.buffers())
    return [tensor.detach() for tensor in tensors if tensor.is_floating_point() == floating]
