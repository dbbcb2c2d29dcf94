"""U-Nets as models: deterministic, by maximum likelihood, or by variational Bayes."""

from __future__ import annotations

from collections.abc import Sized
from typing import Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from shared_schema.manifest import StructuredInfo
from surrogate.data.dataset import Dataset
from surrogate.data.geometry import Geometry
from surrogate.data.samples import Samples
from surrogate.mechanics.linear_response import MOST, LinearResponse
from surrogate.models.model import TrainedModel, require_stiffness
from surrogate.models.training_config import (
    DeterministicTraining,
    LikelihoodTraining,
    RecalibratedTraining,
)
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.unet import UNet, UNetConfig
from surrogate.probabilistic.ensemble import Ensemble
from surrogate.probabilistic.flipout import VariationalConfig
from surrogate.probabilistic.likelihoods import output_channels
from surrogate.seeds import INITIAL_WEIGHTS, stream

GROWTH = {1: "constant", 2: "doubling"}
ACTIVATIONS = {"relu": "ReLU", "silu": "SiLU"}


class UNetModel(TrainedModel):
    """One U-Net, or an ensemble of them.

    Attributes
    ----------
    network : UNetConfig
    ensemble : int
        Number of U-Nets, trained together from different initial weights.
    """

    title = "U-Net"

    model: Literal["unet"] = "unet"
    network: UNetConfig = UNetConfig()
    ensemble: int = Field(1, ge=1, le=100)
    training: RecalibratedTraining

    @model_validator(mode="after")
    def _one_transform_a_member_at_most(self) -> Self:
        if len(self.network.force_transforms) > self.ensemble:
            raise ValueError(
                f"'network.force_transforms' = {list(self.network.force_transforms)}: expected "
                f"{self.ensemble} at most, the number of networks ('ensemble')"
            )
        return self

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

    def build(self, geometry: Geometry, info: StructuredInfo) -> FieldNetwork:
        """Build the network between fields in SI units, with the linear response if it is used."""
        config = self.network
        network = self.make_network(geometry.dimension, torch.from_numpy(geometry.free_mask))
        linear = LinearResponse(geometry) if config.needs_linear_response else None
        return FieldNetwork(network, geometry, info, linear, config.inputs, config.skip == "linear")

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError unless the data hold what the linear response needs."""
        if not self.network.needs_linear_response:
            return
        inputs, skip = list(self.network.inputs), self.network.skip
        where = f"config '{self.name}': key 'network': inputs = {inputs}, skip = '{skip}'"
        geometry = dataset.geometry
        free = geometry.dimension * int((~geometry.clamped).sum())
        if free > MOST:
            raise InputError(
                f"{where}: the body has {free} free degrees of freedom, expected {MOST} at most"
            )
        require_stiffness(dataset, where)

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Set the linear response, then the scales."""
        if isinstance(network.linear, LinearResponse):
            assert dataset.stiffness is not None
            network.linear.fit(dataset.stiffness, train.force)
        super().start_from_data(network, dataset, train)

    def make_network(self, dimension: int, free: Tensor) -> nn.Module:
        """Build the U-Net, or the ensemble: (N, d, *grid) → (K·N, d or 2d, *grid)."""
        members = [self._member(dimension, number) for number in range(self.ensemble)]
        return Ensemble(members) if self.ensemble > 1 else members[0]

    def _member(self, dimension: int, number: int) -> UNet:
        """Build one U-Net; member 0 has the same initial weights as a single U-Net."""
        others = (number,) if number else ()
        torch.manual_seed(stream(self.seed, INITIAL_WEIGHTS, *others))
        outputs = output_channels(self.likelihood, dimension)
        return UNet(dimension, outputs, self.network, self.posterior, number)

    def input_channels(self, dimension: int) -> int:
        """Return the number of channels of the input in d dimensions."""
        return self.network.input_channels(dimension)

    @property
    def predicts_std(self) -> bool:
        """True for an ensemble, and for a network that predicts standard deviations."""
        return self.ensemble > 1 or super().predicts_std

    @property
    def values_per_point(self) -> int:
        """Number of channels of the finest level."""
        return self.network.channels

    @property
    def architecture(self) -> str:
        """Describe the network, such as "4 U-Nets, 3 levels, c = 16, doubling, SiLU"."""
        network = self.network
        count = f"{self.ensemble} U-Nets" if self.ensemble > 1 else "U-Net"
        growth = GROWTH.get(network.multiplier, f"×{network.multiplier}")
        activation = ACTIVATIONS.get(network.activation, network.activation)
        norm = ", batch norm" if network.batch_norm else ""
        shape = f"{network.levels} levels, c = {network.channels}"
        linear = ", linear response" if network.needs_linear_response else ""
        return f"{count}, {shape}, {growth}, {activation}{norm}{linear}"


class DeterministicUNet(UNetModel):
    """U-Nets that predict displacements; ensembles and dropout add standard deviations."""

    likelihood: Literal["deterministic"] = "deterministic"
    training: DeterministicTraining = DeterministicTraining()

    @model_validator(mode="after")
    def _recalibrates_standard_deviations(self) -> Self:
        if self.training.recalibrate and not (self.predicts_std or self.network.dropout):
            raise ValueError(
                "'training.recalibrate' = True: expected a model that predicts standard deviations "
                "('likelihood', 'ensemble' or 'network.dropout')"
            )
        return self

    @property
    def objective(self) -> str:
        """Name of the loss."""
        return self.training.objective


class MaximumLikelihoodUNet(UNetModel):
    """U-Nets that predict a mean and a standard deviation of every component."""

    likelihood: Literal["maximum_likelihood"] = "maximum_likelihood"
    training: LikelihoodTraining = LikelihoodTraining()

    @property
    def objective(self) -> str:
        """Name of the loss."""
        return "negative log-likelihood"

    @property
    def method(self) -> str:
        """Name of the method, for the summary."""
        return "maximum likelihood"


class BayesianUNet(UNetModel):
    """U-Nets with random weights, trained by variational Bayes.

    Attributes
    ----------
    variational : VariationalConfig
        Random weights and their priors.
    """

    likelihood: Literal["variational_bayes"] = "variational_bayes"
    variational: VariationalConfig
    training: LikelihoodTraining = LikelihoodTraining()

    @model_validator(mode="after")
    def _levels_of_the_network(self) -> Self:
        levels = self.variational.levels or ()
        if not set(levels) <= set(range(self.network.levels)):
            raise ValueError(
                f"'variational.levels' = {list(levels)}, expected levels of the network, "
                f"0 to {self.network.levels - 1}"
            )
        return self

    @property
    def posterior(self) -> VariationalConfig:
        """Configuration of the random weights."""
        return self.variational

    @property
    def objective(self) -> str:
        """Name of the loss."""
        return "negative evidence lower bound"

    @property
    def method(self) -> str:
        """Name of the method, for the summary."""
        return "variational Bayes"
