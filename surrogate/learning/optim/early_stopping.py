"""Early stopping: the weights with the smallest validation loss become the model."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from surrogate.learning.optim.optimisation_keys import EarlyStoppingConfig

NETWORK = "network."


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
