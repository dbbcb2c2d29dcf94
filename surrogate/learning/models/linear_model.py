"""The paper's linear layer as a model: it starts at K⁻¹ and is trained like a network."""

from __future__ import annotations

from collections.abc import Sized
from typing import TYPE_CHECKING, Literal, Self

from pydantic import model_validator
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.model import Regression, TrainedModel, require_stiffness
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.linear_map import LinearMap, compliance_of

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset


class LinearModel(TrainedModel):
    """One dense layer without bias between nodal forces and displacements."""

    title = "linear layer"
    likelihoods = (Regression,)

    model: Literal["linear"]

    @model_validator(mode="after")
    def _trained_by_adam(self) -> Self:
        for key, value, default in (
            ("name", self.training.optimiser.name, "adam"),
            ("rho_factor", self.training.optimiser.rho_factor, 1.0),
        ):
            if value != default:
                raise ValueError(
                    f"'training.optimiser.{key}' = {value!r}: expected {default!r} "
                    "of model 'linear'"
                )
        return self

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Build the layer; its weights are zero until `start_from_data`."""
        return LinearMap(dimension, free)

    def require_suitable(self, dataset: Dataset, train: Sized) -> None:
        """Raise InputError unless the grid points are nodes and the dataset holds the stiffness."""
        where = f"config '{self.name}': key 'model' = 'linear'"
        if not dataset.geometry.grid.points_are_nodes:
            raise InputError(
                f"{where}: the dataset's grid is embedded on its mesh, expected one whose points "
                "are nodes"
            )
        require_stiffness(dataset, where)

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Set the scales, and the weights to K⁻¹."""
        super().start_from_data(network, dataset, train)
        layer, geometry = network.network, dataset.geometry
        assert isinstance(layer, LinearMap)
        assert dataset.stiffness is not None
        grid = geometry.grid
        nodes = grid.node_at[grid.moved_by(~geometry.clamped)]
        compliance = compliance_of(dataset.stiffness, nodes, geometry.free)
        layer.start_at(compliance, network.force_scale, network.displacement_scale)

    @property
    def architecture(self) -> str:
        """Describe the network."""
        return "linear layer"
