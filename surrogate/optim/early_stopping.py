"""Early stopping: the weights that are best on the validation part become the model."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from pydantic import Field
from torch import Tensor, nn

from shared_schema.common.configuration import Frozen

NETWORK = "network."


class EarlyStoppingConfig(Frozen):
    """When a training stops before its last epoch.

    Attributes
    ----------
    patience : int
        Epochs in a row after which it stops if none has brought the validation loss below its
        smallest value so far.
    """

    patience: int = Field(gt=0)


class EarlyStopping:
    """The best weights so far, and how long ago they were found.

    Attributes
    ----------
    best_epoch : int
        Counted from 1; 0 if there is none yet.
    best_loss : float
        Validation loss there.
    best : dict of Tensor
        The network's state there.
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
        """Tell whether the training ends after an epoch (counted from 1)."""
        return epoch - self.best_epoch >= self.patience

    def state_dict(self) -> dict[str, Tensor]:
        """Everything as tensors, for the checkpoint."""
        return {
            "best_epoch": torch.tensor(self.best_epoch),
            "best_loss": torch.tensor(self.best_loss, dtype=torch.float64),
            **{NETWORK + name: value for name, value in self.best.items()},
        }

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Take up what `state_dict` gave."""
        self.best_epoch, self.best_loss = int(state["best_epoch"]), float(state["best_loss"])
        self.best = {
            name.removeprefix(NETWORK): value
            for name, value in state.items()
            if name.startswith(NETWORK)
        }
