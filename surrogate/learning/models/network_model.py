"""Networks of any of the three likelihoods, alone or in an ensemble."""

from __future__ import annotations

from abc import abstractmethod
from typing import Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.training_config import RecalibratedTraining
from surrogate.learning.probabilistic.ensemble import Ensemble
from surrogate.runtime.seeds import INITIAL_WEIGHTS, stream


class NetworkModel(TrainedModel):
    """One network, or an ensemble of networks.

    Attributes
    ----------
    ensemble : int
        Number of networks, trained together from different initial weights.
    """

    ensemble: int = Field(1, ge=1, le=100)
    training: RecalibratedTraining

    @model_validator(mode="after")
    def _factor_of_trained_standard_deviations(self) -> Self:
        trained = self.posterior is not None and self.posterior.posterior_std == "gradient"
        factor = self.training.optimiser.rho_factor
        if factor != 1 and not trained:
            raise ValueError(
                f"'training.optimiser.rho_factor' = {factor}: expected 1, as no standard deviation "
                "of a weight is trained by gradients"
            )
        return self

    @model_validator(mode="after")
    def _recalibrates_standard_deviations(self) -> Self:
        if self.training.recalibrate and not (self.predicts_std or self.has_dropout):
            raise ValueError(
                f"'training.recalibrate' = {self.training.recalibrate}: expected a model that "
                "predicts standard deviations ('likelihood', 'ensemble' or 'network.dropout')"
            )
        return self

    def members(self, free: Tensor) -> nn.Module:
        """Build the network, or the ensemble; member 0 has the weights of a single network."""
        networks = []
        for number in range(self.ensemble):
            torch.manual_seed(stream(self.seed, INITIAL_WEIGHTS, *((number,) if number else ())))
            networks.append(self.member(free, number))
        return Ensemble(networks) if self.ensemble > 1 else networks[0]

    @abstractmethod
    def member(self, free: Tensor, number: int) -> nn.Module:
        """Build one network on a grid, (nx, ny[, nz]), given its number in the ensemble."""

    @property
    def predicts_std(self) -> bool:
        """True for an ensemble, and for a network that predicts standard deviations."""
        return self.ensemble > 1 or super().predicts_std

    @property
    def has_dropout(self) -> bool:
        """True if passes differ by dropout."""
        return False
