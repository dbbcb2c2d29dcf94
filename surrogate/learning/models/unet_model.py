"""U-Nets as models, with any of the three likelihoods."""

from __future__ import annotations

import math
from collections.abc import Sized
from typing import TYPE_CHECKING, Literal, Self

from pydantic import model_validator
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from shared_schema.materials import Materials
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.model import (
    Deterministic,
    MaximumLikelihood,
    VariationalBayes,
)
from surrogate.learning.models.network_model import NetworkModel
from surrogate.learning.networks.field_network import Channels, FieldNetwork, Input
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.flipout import VariationalConvolutions
from surrogate.learning.probabilistic.likelihoods import output_channels
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.series.series_response import SeriesResponse

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset

GROWTH = {1: "constant", 2: "doubling"}
SCALED_BY = 500  # samples at most, evenly spaced, that tell the scales of a network on a series
ACTIVATIONS = {"relu": "ReLU", "silu": "SiLU"}


class UNetModel(NetworkModel):
    """One U-Net, or an ensemble of them.

    Attributes
    ----------
    network : UNetConfig
        Architecture of the U-Net.
    """

    title = "U-Net"
    likelihoods = Deterministic, MaximumLikelihood, VariationalBayes[VariationalConvolutions]

    model: Literal["unet"] = "unet"
    network: UNetConfig = UNetConfig()

    @model_validator(mode="after")
    def _one_transform_a_member_at_most(self) -> Self:
        if len(self.network.force_transforms) > self.ensemble:
            raise ValueError(
                f"'network.force_transforms' = {list(self.network.force_transforms)}: expected "
                f"{self.ensemble} at most, the number of networks ('ensemble')"
            )
        return self

    @model_validator(mode="after")
    def _random_levels_of_the_network(self) -> Self:
        levels = self.random_convolutions.levels if self.random_convolutions else None
        if not set(levels or ()) <= set(range(self.network.levels)):
            raise ValueError(
                f"'variational.levels' = {list(levels or ())}, expected levels of the network, "
                f"0 to {self.network.levels - 1}"
            )
        return self

    @property
    def random_convolutions(self) -> VariationalConvolutions | None:
        """Choice of the convolutions with random weights; None if all are deterministic."""
        posterior = self.posterior
        assert posterior is None or isinstance(posterior, VariationalConvolutions)
        return posterior

    @property
    def needs_material(self) -> bool:
        """True if the network contains the linear response of the body."""
        return self.network.needs_linear_response

    @property
    def has_series(self) -> bool:
        """True if the network goes on from the linear response by a load series."""
        return self.network.skip == "series"

    @property
    def has_own_series(self) -> bool:
        """True if it has a series."""
        return self.has_series

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs of the network."""
        return self.network.inputs

    @property
    def adds_response(self) -> bool:
        """True if the network's output is added to the response of the body."""
        return self.network.skip != "none"

    def response(self, geometry: Geometry, material: Materials) -> LinearResponse:
        """Return the linear response of the body, or its load series."""
        if self.has_series:
            order = self.network.series_order
            return SeriesResponse(geometry, material, self.network.needs_gradient, order)
        return LinearResponse(geometry, material, self.network.needs_gradient)

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError if the coarsest level would be finer than a point of the grid."""
        super().require_suitable(dataset, train)
        if dataset.geometry.grid.is_a_row:
            raise InputError(
                f"config '{self.name}': a U-Net, on a dataset whose nodes stand in a row: expected "
                "`datagen structure` without --grid nodes, or a reduced network"
            )
        shape, padding = dataset.geometry.grid.shape, self.network.padding
        most = int(math.log2(min(shape) + 2 * padding)) + 1
        if self.network.levels > most:
            grid = " x ".join(str(count) for count in shape)
            raise InputError(
                f"config '{self.name}': key 'network.levels' = {self.network.levels}: expected "
                f"{most} at most, each level halves the {grid} grid (with 'padding' = {padding})"
            )

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Set the scales of gradients and output."""
        if isinstance(network.linear, SeriesResponse):  # every sample takes time
            train = train[:: -(-len(train) // SCALED_BY)]
        if isinstance(network.linear, LinearResponse):
            network.linear.scale_gradient(train.force)
        super().start_from_data(network, dataset, train)

    @property
    def inputs_of_shapes(self) -> tuple[Channels, ...]:
        """Inputs of a network for a family of shapes."""
        return (*self.network.inputs, "shape")

    def require_shapes(self, dataset: Dataset) -> None:
        """Raise InputError if the network contains the response of the body."""
        if self.needs_material:
            raise InputError(
                f"config '{self.name}': key 'network', on samples of many shapes: expected inputs "
                "[force] and skip 'none'"
            )

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the U-Net, or the ensemble: (N, d, *grid) → (K·N, d or 2d, *grid)."""
        return self.members(free, shape)

    def member(self, free: Tensor, number: int, parameters: int = 0) -> UNet:
        """Build one U-Net."""
        outputs, last_axis = output_channels(self.likelihood, free.ndim), free.shape[-1]
        convolutions = self.random_convolutions
        of = free.ndim, outputs, self.network, convolutions, number, last_axis
        return UNet(*of, parameters)

    @property
    def has_dropout(self) -> bool:
        """True if passes differ by dropout."""
        return self.network.dropout > 0

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
        norm += " of the last axis" if network.batch_norm == "last_axis" else ""
        norm += f", group norm ({network.group_norm})" if network.group_norm else ""
        shape = f"{network.levels} levels, c = {network.channels}"
        linear = ", linear response" if network.needs_linear_response else ""
        linear = ", load series" if network.skip == "series" else linear
        return f"{count}, {shape}, {growth}, {activation}{norm}{linear}"
