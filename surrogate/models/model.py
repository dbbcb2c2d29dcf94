"""The base of all kinds of model: what every run is configured by, and what every model does."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor, nn

from shared_schema.common.configuration import Frozen
from shared_schema.manifest import StructuredInfo
from surrogate.data.dataset import Dataset, Samples
from surrogate.data.geometry import Geometry
from surrogate.models.training_config import SplitConfig, TrainingConfig
from surrogate.networks.field_network import FieldNetwork
from surrogate.probabilistic.flipout import VariationalConfig
from surrogate.probabilistic.likelihoods import Likelihood, Prediction
from surrogate.probabilistic.moments import Moments


class Gaussian(NamedTuple):
    """A Gaussian for every displacement component, its variance in two parts.

    Attributes
    ----------
    mean, std_epistemic, std_aleatoric : Tensor, (N, n_nodes, d)
        In m.
    """

    mean: Tensor
    std_epistemic: Tensor
    std_aleatoric: Tensor


class Model(Frozen, ABC):
    """A kind of model, with every key that determines a run of it, the data apart.

    Attributes
    ----------
    name : str
    case : str
        Name of the case whose dataset the run is for.
    recipe : {"paper", "fast", "custom"}
        Origin of the settings: the paper, this project, or the user.
    model, likelihood : str
        Together they choose the kind of model.
    displacement_scale : {"global", "node"}
        Scale of the network's output: one for all, or one for each component of each node.
    training : SplitConfig
        Its keys are those that this kind of model reads.
    seed : int
        Seed of the initial weights, the split, the order of the samples and the noise.
    """

    title: ClassVar[str]

    name: str
    case: str
    recipe: Literal["paper", "fast", "custom"] = "custom"
    model: str
    likelihood: Likelihood
    displacement_scale: Literal["global", "node"] = "global"
    training: SplitConfig
    seed: int = Field(0, ge=0)

    def plain(self) -> dict[str, Any]:
        """Return the whole configuration as plain data."""
        return self.model_dump(mode="json")

    # --- from the configuration and the data to a network -----------------------------------------

    def build(self, geometry: Geometry, info: StructuredInfo) -> FieldNetwork:
        """Build the network between fields in SI units, with the initial weights of the seed."""
        free = torch.from_numpy(geometry.free_mask)
        return FieldNetwork(self.make_network(geometry.dimension, free), geometry, info)

    @abstractmethod
    def make_network(self, dimension: int, free: Tensor) -> nn.Module:
        """Build the network between scaled fields.

        Parameters
        ----------
        dimension : int
            Number of space dimensions d.
        free : Tensor of bool, (nx, ny[, nz])
            Grid points that can move.
        """

    def require_suitable(self, dataset: Dataset, train: Samples) -> None:
        """Raise InputError, naming the key, unless the model can learn from these data."""

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Give a network on the CPU what it takes from the data before the first step.

        Parameters
        ----------
        network : FieldNetwork
            Changed in place: scales, and whatever else a kind of model fits to the data.
        dataset : Dataset
        train : Samples
            The samples that the network may learn from.
        """
        if self.displacement_scale == "node":
            network.scale_by_node(train.displacement)

    @abstractmethod
    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Loss per datum of a prediction, without the KL divergence of random weights.

        Parameters
        ----------
        prediction : Prediction
            Fields in m.
        reference : Tensor, (N, d, nx, ny[, nz])
            Displacements in m.
        network : FieldNetwork
            Network that predicted.
        """

    # --- the predictive distribution --------------------------------------------------------------

    @property
    def posterior(self) -> VariationalConfig | None:
        """Configuration of the random weights; None if all weights are deterministic."""
        return None

    @property
    def predicts_std(self) -> bool:
        """True if one pass of all members predicts standard deviations."""
        return self.likelihood != "deterministic"

    def distribution(self, moments: Moments) -> Gaussian:
        """Turn the moments of all passes into the predictive distribution."""
        return Gaussian(moments.mean, moments.std_epistemic, moments.std_aleatoric)

    @property
    def values_per_point(self) -> int:
        """Number of hidden values at a grid point, which limits how many samples fit in a batch."""
        return 128

    # --- for reports ------------------------------------------------------------------------------

    @property
    @abstractmethod
    def objective(self) -> str:
        """Name of the loss, such as "mean absolute error"."""

    @property
    @abstractmethod
    def architecture(self) -> str:
        """Describe the network in a few words, such as "U-Net, 3 levels, c = 16"."""

    @property
    @abstractmethod
    def training_summary(self) -> str:
        """Describe training or fit in a few words."""


class TrainedModel(Model):
    """A model that is trained by steps of an optimiser.

    Attributes
    ----------
    training : TrainingConfig
    """

    training: TrainingConfig

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Loss per datum of a prediction, as the training is configured."""
        return self.training.data_loss(prediction, reference, network)

    @property
    def method(self) -> str:
        """Name of the method, for the summary."""
        return self.objective.removeprefix("mean ")

    @property
    def training_summary(self) -> str:
        """Describe the training, such as "absolute error, Muon, 80 epochs, batches of 32"."""
        return f"{self.method}, {self.training.in_brief}"
