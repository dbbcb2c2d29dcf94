r"""Weights that become the model: those of the smallest validation loss, or a moving average.

.. math:: \bar w_t = \frac{\sum_{i=1}^t d^{t-i} w_i}{\sum_{i=1}^t d^{t-i}}
   = \bar w_{t-1} + \frac{1 - d}{1 - d^t} (w_t - \bar w_{t-1})

with the decay d. The bias of the start is corrected as for Adam's moments (Kingma and Ba 2015), so
that the average does not contain the initial weights.

`torch.optim.swa_utils.AveragedModel` is not used: it copies its count to the device and reads it
back in every step, so that the host waits for the GPU.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from itertools import chain
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

from surrogate.learning.optim.optimisers import EarlyStoppingConfig

NETWORK = "network."
Network = TypeVar("Network", bound=nn.Module)


class EarlyStopping:
    """Best weights so far, and their epoch.

    Attributes
    ----------
    best_epoch : int
        Epoch of the best weights, counted from 1; 0 before the first.
    best_loss : float
        Validation loss in that epoch.
    best : dict of Tensor
        State of the network in that epoch.
    """

    def __init__(self, config: EarlyStoppingConfig) -> None:
        self.patience = config.patience
        self.best_epoch, self.best_loss = 0, math.inf
        self.best: dict[str, Tensor] = {}

    def observe(self, epoch: int, loss: float, network: nn.Module) -> None:
        """Keep the weights after an epoch (counted from 1) if its validation loss is the best."""
        if loss < self.best_loss:
            self.best_epoch, self.best_loss = epoch, loss
            self.best = {name: value.clone() for name, value in network.state_dict().items()}

    def is_over(self, epoch: int) -> bool:
        """Return True if training ends after an epoch (counted from 1)."""
        return epoch - self.best_epoch >= self.patience

    def state_dict(self) -> dict[str, Tensor]:
        """Return the state as tensors for the checkpoint."""
        return {
            "best_epoch": torch.tensor(self.best_epoch),
            "best_loss": torch.tensor(self.best_loss, dtype=torch.float64),
            **{NETWORK + name: value for name, value in self.best.items()},
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore the state from the tensors of `state_dict`."""
        self.best_epoch, self.best_loss = int(state["best_epoch"]), float(state["best_loss"])
        self.best = {
            name.removeprefix(NETWORK): value
            for name, value in state.items()
            if name.startswith(NETWORK)
        }


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
