"""Base classes of all architectures and likelihoods: common configuration keys and methods."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sized
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, NamedTuple, TypeVar

import torch
from pydantic import BaseModel, Field
from torch import Tensor, nn

from shared_schema.common.configuration import Frozen
from shared_schema.common.errors import InputError
from shared_schema.manifest import StructuredInfo
from shared_schema.materials import Materials
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.training_config import (
    DeterministicTraining,
    LikelihoodTraining,
    RegressionTraining,
    SplitConfig,
    TrainingConfig,
)
from surrogate.learning.networks.field_network import Channels, FieldNetwork, Input, channels_of
from surrogate.learning.probabilistic.distribution import Moments
from surrogate.learning.probabilistic.flipout import VariationalConfig
from surrogate.learning.probabilistic.likelihoods import Likelihood, Prediction
from surrogate.mechanics.body.elements_of_case import body_of_response, with_dilations
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.linear_response import LinearResponse, required

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

RandomWeights = TypeVar("RandomWeights", bound=VariationalConfig)
METHODS = {"maximum_likelihood": "maximum likelihood", "variational_bayes": "variational Bayes"}


class Deterministic(Frozen):
    """Networks that predict displacements; ensembles and dropout add standard deviations."""

    likelihood: Literal["deterministic"] = "deterministic"
    training: DeterministicTraining = DeterministicTraining()


class MaximumLikelihood(Frozen):
    """Networks that predict a mean and a standard deviation of every component."""

    likelihood: Literal["maximum_likelihood"] = "maximum_likelihood"
    training: LikelihoodTraining = LikelihoodTraining()


class VariationalBayes(Frozen, Generic[RandomWeights]):
    """Networks with random weights, trained by variational Bayes.

    Attributes
    ----------
    variational : VariationalConfig
        Random weights and their priors.
    """

    likelihood: Literal["variational_bayes"] = "variational_bayes"
    variational: RandomWeights
    training: LikelihoodTraining = LikelihoodTraining()

    @property
    def posterior(self) -> RandomWeights:
        """Configuration of the random weights."""
        return self.variational


class Regression(Frozen):
    """One dense layer that predicts displacements."""

    likelihood: Literal["deterministic"] = "deterministic"
    training: RegressionTraining = RegressionTraining()


class Untrained(Frozen):
    """A model that follows from the body, and predicts displacements."""

    likelihood: Literal["deterministic"] = "deterministic"


class Gaussian(NamedTuple):
    """A Gaussian for every displacement component, with epistemic and aleatoric variance.

    Attributes
    ----------
    mean, std_epistemic, std_aleatoric : Tensor, (N, n_nodes, d)
        Mean and standard deviations in m.
    """

    mean: Tensor
    std_epistemic: Tensor
    std_aleatoric: Tensor


class Model(Frozen, ABC):
    """An architecture, which the keys of a likelihood complete (`surrogate.learning.models.kinds`).

    Attributes
    ----------
    name : str
        Name of the configuration, for reports and messages.
    case : str
        Name of the case whose dataset the run is for.
    recipe : {"paper", "fast", "custom"}
        Origin of the settings: the paper, this project, or the user.
    model, likelihood : str
        Kind of model, chosen by both keys together.
    displacement_scale : {"global", "node"}
        Scale of the network's output: one for the whole field, or one for each component of each
        node.
    training : SplitConfig
        Settings of the training; each kind of model has only the keys that it reads.
    seed : int
        Seed of the initial weights, the split, the order of the samples and the noise.
    """

    title: ClassVar[str]
    likelihoods: ClassVar[tuple[type[BaseModel], ...]]  # the keys of each that it goes with
    learns: ClassVar[bool] = True  # from samples; if not, the body alone makes the model

    name: str
    case: str
    recipe: Literal["paper", "fast", "custom"] = "custom"
    model: str
    likelihood: Likelihood
    displacement_scale: Literal["global", "node"] = "global"
    training: SplitConfig
    seed: int = Field(0, ge=0, lt=2**63)

    def plain(self) -> dict[str, Any]:
        """Return the whole configuration as plain data."""
        return self.model_dump(mode="json")

    # --- from the configuration and the data to a network -----------------------------------------

    @property
    def needs_material(self) -> bool:
        """True if the network contains the linear response of the body."""
        return False

    @property
    def has_series(self) -> bool:
        """True if the network goes on from the linear response by a load series."""
        return False

    @property
    def has_own_series(self) -> bool:
        """True if the response is a load series of the body's own elements, materials and loads."""
        return False

    def build_for(
        self,
        geometry: Geometry,
        info: StructuredInfo,
        material: Materials | None,
        case: Mapping[str, Any],
        before: bool = False,
    ) -> FieldNetwork:
        """Build the network of a body whose elements its case configuration names.

        One that has learned `before` networks had load series of the body's own elements and loads
        keeps that of linear ones under dead loads.
        """
        if material is not None and self.has_own_series and not before:
            geometry = with_dilations(geometry, case)
        elif material is not None:
            geometry, material = body_of_response(geometry, material, case, self.has_series)
        return self.build(geometry, info, material)

    def build(
        self, geometry: Geometry, info: StructuredInfo, material: Materials | None = None
    ) -> FieldNetwork:
        """Build the network that maps fields in SI units, with initial weights from the seed.

        Parameters
        ----------
        geometry : Geometry
        info : StructuredInfo
        material : ShippedMaterial or tuple of some, optional
            Material of the body, for networks that contain its linear response.
        """
        free = torch.from_numpy(geometry.free_mask)
        network = self.make_network(geometry.dimension, free, geometry.shape)
        linear = self.response(geometry, required(material)) if self.needs_material else None
        inputs = self.inputs if geometry.shape is None else self.inputs_of_shapes
        return FieldNetwork(network, geometry, info, linear, inputs, self.adds_response)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs of the network."""
        return ("force",)

    @property
    def inputs_of_shapes(self) -> tuple[Channels, ...]:
        """Inputs of a network for a family of shapes."""
        return self.inputs

    def require_shapes(self, dataset: Dataset) -> None:
        """Raise InputError unless the model can learn from a family of shapes."""
        raise InputError(
            f"config '{self.name}': key 'model' = '{self.model}', on samples of many shapes: "
            "expected 'reduced', 'unet' or 'series'"
        )

    @property
    def adds_response(self) -> bool:
        """True if the network's output is added to the response of the body."""
        return self.needs_material

    def response(self, geometry: Geometry, material: Materials) -> LinearResponse:
        """Return the linear response of the body, or its load series."""
        return LinearResponse(geometry, material, gradient=False)

    @abstractmethod
    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the network that maps scaled forces to scaled displacements.

        Parameters
        ----------
        dimension : int
            Number of space dimensions d.
        free : Tensor of bool, (nx, ny[, nz])
            True at grid points that are nodes and not clamped.
        shape : Tensor, (n_parameters,), optional
            Parameters of the body's shape between −1 and 1, of a family of shapes.
        """

    def input_channels(self, dimension: int, shape: Tensor | None = None) -> int:
        """Return the number of channels of the network's input in d dimensions."""
        inputs: tuple[Channels, ...] = self.inputs if shape is None else self.inputs_of_shapes
        count = 0 if shape is None else len(shape)
        return channels_of(inputs, dimension, count)[inputs[-1]].stop

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError, naming the key, unless the model can learn from these data."""

    def require_modes(self, dataset: Dataset, train: Sized, modes: Mapping[str, int]) -> None:
        """Raise InputError if a key asks for more modes than samples or free components."""
        most = min(len(train), int(dataset.geometry.movable.sum()))
        for key, count in modes.items():
            if count > most:
                raise InputError(
                    f"config '{self.name}': key '{key}' = {count}: expected {most} at most, the "
                    "smaller of the numbers of training samples and of free degrees of freedom"
                )

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Initialise a network on the CPU from the data, before the first step.

        Parameters
        ----------
        network : FieldNetwork
            Network that is changed in place: its scales, and all that this kind of model fits to
            the data directly.
        dataset : Dataset
        train : Samples
            Samples that the network may learn from.
        """
        by_node = self.displacement_scale == "node"
        if by_node or network.skip:
            network.scale_output(network.prepared(train), by_node)

    @abstractmethod
    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the loss per datum of a prediction, without the KL divergence of random weights.

        Parameters
        ----------
        prediction : Prediction
            Predicted fields in m.
        reference : Tensor, (N, d, nx, ny[, nz])
            Reference displacements in m.
        network : FieldNetwork
            Network that made the prediction.
        """

    # --- the predictive distribution --------------------------------------------------------------

    @property
    def posterior(self) -> VariationalConfig | None:
        """Configuration of the random weights; None if all weights are deterministic."""
        return None

    @property
    def predicts_std(self) -> bool:
        """True if a single pass of all members predicts standard deviations."""
        return self.likelihood != "deterministic"

    def distribution(self, moments: Moments) -> Gaussian:
        """Convert the moments of all passes to the predictive distribution."""
        return Gaussian(moments.mean, moments.std_epistemic, moments.std_aleatoric)

    @property
    def values_per_point(self) -> int:
        """Number of hidden values at a grid point; it limits the number of samples in a batch."""
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
        """Describe the training or the fit in a few words."""


class TrainedModel(Model):
    """A model that an optimiser trains step by step.

    Attributes
    ----------
    training : TrainingConfig
    """

    training: TrainingConfig

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the loss per datum that the training configuration chooses."""
        return self.training.data_loss(prediction, reference, network)

    @property
    def objective(self) -> str:
        """Name of the loss."""
        bound = "negative evidence lower bound"
        return self.training.objective if self.posterior is None else bound

    @property
    def training_summary(self) -> str:
        """Describe the training, such as "absolute error, Muon, 80 epochs, batches of 32"."""
        method = METHODS.get(self.likelihood, self.objective.removeprefix("mean "))
        return f"{method}, {self.training.in_brief}"


def require_stiffness(dataset: Dataset, where: str) -> None:
    """Raise InputError, beginning with `where`, unless a dataset has the stiffness of its body."""
    if dataset.stiffness is None:
        raise InputError(
            f"{where}: the dataset has no stiffness; make it again, by 'datagen structure' into a "
            "new folder (quadratic elements, incompressible triangles and tetrahedra have none)"
        )
