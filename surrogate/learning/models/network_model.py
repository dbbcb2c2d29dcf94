"""Networks of any of the three likelihoods, alone or in an ensemble, and the memory they train in.

The memory is estimated before any of it is allocated. The network is built on torch's device
``meta``, whose tensors have shapes and no values. A batch is sent through it; autograd says which
tensors it keeps for the gradients.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.training_config import RecalibratedTraining
from surrogate.learning.optim.optimisers import is_hidden_kernel
from surrogate.learning.probabilistic.stochastic_passes import Ensemble
from surrogate.mechanics.body.geometry import Geometry
from surrogate.runtime.device import INITIAL_WEIGHTS, stream

META = torch.device("meta")


def training_memory(config: TrainedModel, geometry: Geometry, batch: int) -> int:
    """Estimate the memory of a training in bytes, from below.

    Weights, their gradients, the states of the optimisers, the averages and the best weights, and
    the values of a batch that gradients need.

    Parameters
    ----------
    config : TrainedModel
    geometry : Geometry
    batch : int
        Number of samples of a batch.

    Returns
    -------
    int
        0 for a network that cannot be built without values.
    """
    training, free = config.training, torch.from_numpy(geometry.free_mask)
    shape = geometry.shape
    kept: dict[int, int] = {}

    def keep(value: Tensor) -> Tensor:
        storage = value.untyped_storage()
        kept[storage._cdata] = storage.nbytes()
        return value

    try:
        with META:
            network = config.make_network(geometry.dimension, free, shape).to(META)
            channels = config.input_channels(geometry.dimension, shape)
            values = torch.zeros(batch, channels, *free.shape)
        with torch.autograd.graph.saved_tensors_hooks(keep, lambda value: value):
            network(values)
    except NotImplementedError:
        return 0
    copies = 2 + (training.ema is not None) + (training.early_stopping is not None)
    weights = 0
    for name, parameter in network.named_parameters():
        by_muon = training.optimiser.name == "muon" and is_hidden_kernel(name, parameter)
        weights += parameter.nbytes * (copies + (1 if by_muon else 2))
        kept.pop(parameter.untyped_storage()._cdata, None)
    share = 0.5 if training.precision == "bfloat16" else 1
    return weights + int(share * sum(kept.values()))


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

    def members(self, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the network, or the ensemble; member 0 has the weights of a single network."""
        networks = []
        for number in range(self.ensemble):
            torch.manual_seed(stream(self.seed, INITIAL_WEIGHTS, *((number,) if number else ())))
            networks.append(self.member(free, number, 0 if shape is None else len(shape)))
        return Ensemble(networks) if self.ensemble > 1 else networks[0]

    @abstractmethod
    def member(self, free: Tensor, number: int, parameters: int = 0) -> nn.Module:
        """Build one network on a grid, (nx, ny[, nz]), given its number in the ensemble.

        It has further inputs for the parameters of shapes.
        """

    @property
    def predicts_std(self) -> bool:
        """True for an ensemble, and for a network that predicts standard deviations."""
        return self.ensemble > 1 or super().predicts_std

    @property
    def has_dropout(self) -> bool:
        """True if passes differ by dropout."""
        return False
