"""Reduced networks as models, with any of the three likelihoods."""

from __future__ import annotations

from collections.abc import Sized
from typing import TYPE_CHECKING, Literal, Self

from pydantic import model_validator
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.terms_on_grid import series_on_grid
from surrogate.learning.models.model import (
    Deterministic,
    MaximumLikelihood,
    VariationalBayes,
)
from surrogate.learning.models.network_model import NetworkModel
from surrogate.learning.networks.field_network import Channels, FieldNetwork
from surrogate.learning.networks.modes import chosen_rows
from surrogate.learning.networks.reduced_network import (
    DenseNetwork,
    ReducedConfig,
    ReducedNetwork,
    VariationalLayers,
)
from surrogate.learning.probabilistic.likelihoods import output_channels
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.runtime.device import INITIAL_WEIGHTS, stream

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

LARGEST_FIT = 6000  # samples that a series is fitted to


class ReducedModel(NetworkModel):
    """One reduced network, or an ensemble whose members share their modes.

    Attributes
    ----------
    network : ReducedConfig
        Numbers of modes, and the dense network between them.
    """

    title = "reduced network"
    likelihoods = Deterministic, MaximumLikelihood, VariationalBayes[VariationalLayers]

    model: Literal["reduced"]
    network: ReducedConfig = ReducedConfig()

    @model_validator(mode="after")
    def _random_layers_of_the_network(self) -> Self:
        layers = self.random_layers.layers if self.random_layers else None
        if not set(layers or ()) <= set(range(self.network.depth + 1)):
            raise ValueError(
                f"'variational.layers' = {list(layers or ())}, expected layers of the network, "
                f"0 to {self.network.depth}"
            )
        return self

    @property
    def random_layers(self) -> VariationalLayers | None:
        """Choice of the layers with random weights; None if all are deterministic."""
        posterior = self.posterior
        assert posterior is None or isinstance(posterior, VariationalLayers)
        return posterior

    @property
    def needs_material(self) -> bool:
        """True: the network contains the linear response of the body."""
        return True

    @property
    def has_series(self) -> bool:
        """True if the network goes on from the linear response by a load series."""
        return bool(self.network.series)

    @property
    def inputs_of_shapes(self) -> tuple[Channels, ...]:
        """Inputs of a network for a family of shapes, whose responses have the same modes."""
        return "response", "shape"

    def require_shapes(self, dataset: Dataset) -> None:
        """Raise InputError unless the grid points are nodes and there is no load series."""
        where = f"config '{self.name}': key"
        if self.network.series:
            raise InputError(
                f"{where} 'network.series' = {list(self.network.series)}: expected none for "
                "samples of many shapes"
            )
        if not dataset.geometry.grid.points_are_nodes:
            raise InputError(
                f"{where} 'model' = 'reduced', on samples of many shapes: expected a dataset "
                "of `datagen structure --grid nodes`"
            )

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the network; its modes are empty until `start_from_data`."""
        return ReducedNetwork(self.members(free, shape), self.network, dimension, free, shape)

    def member(self, free: Tensor, number: int, parameters: int = 0) -> nn.Module:
        """Build one dense network."""
        outputs = output_channels(self.likelihood, self.network.output_modes)
        return DenseNetwork(self.network, outputs, self.random_layers, parameters)

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError if there are more modes than samples or free degrees of freedom."""
        modes = {
            "network.input_modes": self.network.input_modes,
            "network.output_modes": self.network.output_modes,
        }
        self.require_modes(dataset, train, modes)

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Set the scale, then the modes."""
        prepared = network.prepared(train)
        network.scale_output(prepared, self.displacement_scale == "node")
        correction = prepared.displacement
        reduced, response = network.network, network.linear
        assert isinstance(reduced, ReducedNetwork)
        assert isinstance(response, LinearResponse)
        of_responses = network.shape is not None
        reduced.fit(
            (lambda field: field) if of_responses else (lambda force: response(force)[0]),
            train.displacement - correction,
            correction / network.displacement_scale,
            network.displacement_rms if of_responses else network.force_scale,
            stream(self.seed, INITIAL_WEIGHTS),
        )
        if reduced.series is not None:
            self._fit_series(network, dataset, Samples(train.force, correction))

    def _fit_series(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Fit the series to its terms under some training forces; `train` holds corrections."""
        rows = chosen_rows(len(train), stream(self.seed, INITIAL_WEIGHTS), LARGEST_FIT)
        some, reduced = train[rows], network.network
        assert isinstance(reduced, ReducedNetwork)
        assert isinstance(network.linear, LinearResponse)
        terms = series_on_grid(dataset, network.linear, some.force)
        scale = network.displacement_scale
        reduced.fit_series(
            some.force / network.force_scale,
            [term * network.movable / scale for term in terms[: len(self.network.series)]],
            some.displacement / scale,
        )

    @property
    def architecture(self) -> str:
        """Describe the network, such as "reduced network, 48 → 3 × 256 → 96, linear response"."""
        network = self.network
        count = f"{self.ensemble} reduced networks" if self.ensemble > 1 else "reduced network"
        shape = f"{network.input_modes} → {network.depth} × {network.width}"
        inside = "load series" if network.series else "linear response"
        return f"{count}, {shape} → {network.output_modes}, {inside}"
