"""Proper orthogonal decomposition as a model: fitted directly, with one of two regressions."""

from __future__ import annotations

from collections.abc import Sized
from typing import TYPE_CHECKING, Literal

from torch import Tensor, nn

from shared_schema.common.configuration import Frozen
from shared_schema.common.machine import require_memory
from surrogate.contrib.pod import GaussianProcessConfig, PODConfig, PODNetwork, RidgeConfig
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.model import Gaussian, Model
from surrogate.learning.models.training_config import SplitConfig
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.probabilistic.distribution import Moments
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.runtime.device import INITIAL_WEIGHTS, stream

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset


class Ridge(Frozen):
    """Coefficients of modes by ridge regression on polynomials of the forces."""

    likelihood: Literal["deterministic"] = "deterministic"
    pod: RidgeConfig


class GaussianProcess(Frozen):
    """Coefficients of modes, with standard deviations, by a Gaussian process."""

    likelihood: Literal["maximum_likelihood"]
    pod: GaussianProcessConfig


class PODModel(Model):
    """Orthogonal modes of the displacements, and a regression of their coefficients.

    Attributes
    ----------
    pod : PODConfig
        Modes, and the regression of their coefficients.
    """

    title = "POD regression"
    likelihoods = (Ridge, GaussianProcess)

    model: Literal["pod"]
    pod: PODConfig
    training: SplitConfig = SplitConfig()

    @property
    def needs_material(self) -> bool:
        """True if the network contains the linear response of the body."""
        return self.pod.linear_modes > 0

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the network, empty until `start_from_data` fits it."""
        return PODNetwork(self.pod, free)

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError for more modes than the samples can have, or if memory is short."""
        modes = {"pod.rank": self.pod.rank or 0, "pod.input_modes": self.pod.linear_modes}
        self.require_modes(dataset, train, modes)
        geometry = dataset.geometry
        loadable = int(geometry.loadable.sum())
        needed = self.pod.memory(len(train), geometry.dimension, loadable)
        require_memory(needed, f"config '{self.name}': key 'pod': the fit")

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Set the scales, then fit modes and regression."""
        super().start_from_data(network, dataset, train)
        pod, response, seed = network.network, network.linear, stream(self.seed, INITIAL_WEIGHTS)
        assert isinstance(pod, PODNetwork)
        learned = network.prepared(train)
        if isinstance(response, LinearResponse):
            linear = train.displacement - learned.displacement
            pod.fit_encoder(lambda force: response(force)[0], linear, network.force_scale, seed)
        pod.fit(
            network.scaled(learned.force), learned.displacement / network.displacement_scale, seed
        )

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the loss per datum of the regression."""
        return self.pod.data_loss(prediction, reference, network)

    def distribution(self, moments: Moments) -> Gaussian:
        """Report the predicted standard deviation as epistemic: dense data make it small."""
        return Gaussian(moments.mean, moments.std_aleatoric, moments.std_epistemic)

    @property
    def objective(self) -> str:
        """Name of the loss."""
        return self.pod.objective

    @property
    def training_summary(self) -> str:
        """Describe the fit."""
        return self.pod.summary

    @property
    def architecture(self) -> str:
        """Describe the model."""
        modes = self.pod.linear_modes
        return f"{modes} linear modes → orthogonal modes" if modes else "orthogonal modes"
