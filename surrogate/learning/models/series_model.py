"""The response of the body as a model: it follows from mesh, supports and material, without data.

It is the load series of the body (`surrogate.mechanics.series`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

import torch
from pydantic import Field
from torch import Tensor, nn

from shared_schema.materials import Materials
from surrogate.learning.data.samples import Samples
from surrogate.learning.models.model import Model, Untrained
from surrogate.learning.models.training_config import SplitConfig
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.probabilistic.likelihoods import Prediction, deterministic_loss
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.series import SeriesResponse

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset


class NoNetwork(nn.Module):
    """Zero displacements on the grid, of a surrogate that is the response of the body alone."""

    def forward(self, inputs: Tensor) -> Tensor:
        """Return zeros: (N, d, nx, ny[, nz]) → same."""
        return torch.zeros_like(inputs)


class SeriesModel(Model):
    """The load series of the body, without a network.

    Attributes
    ----------
    series_order : int
        Order of the series' last term; 1 is the linear response.
    training : SplitConfig
        Samples for conformal intervals and fast bounds, of a dataset that has some; the model
        itself takes nothing from them.
    """

    title = "load series"
    likelihoods = (Untrained,)
    learns: ClassVar[bool] = False

    model: Literal["series"]
    series_order: int = Field(5, ge=1, le=8)
    training: SplitConfig = SplitConfig()

    @property
    def needs_material(self) -> bool:
        """True: the model is the response of the body."""
        return True

    @property
    def has_own_series(self) -> bool:
        """True, unless it is the linear response."""
        return self.series_order > 1

    def response(self, geometry: Geometry, material: Materials) -> LinearResponse:
        """Return the load series, or the linear response."""
        if not self.has_own_series:
            return super().response(geometry, material)
        return SeriesResponse(geometry, material, False, self.series_order)

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        """Return what adds nothing to the response."""
        return NoNetwork()

    def start_from_data(self, network: FieldNetwork, dataset: Dataset, train: Samples) -> None:
        """Take nothing from the data."""

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the mean absolute error in units of the displacements."""
        return deterministic_loss("mae", prediction.mean, reference, network.displacement_rms)

    @property
    def objective(self) -> str:
        """Name of the loss."""
        return "mean absolute error"

    @property
    def training_summary(self) -> str:
        """Say that there is no training."""
        return "no training"

    @property
    def architecture(self) -> str:
        """Describe the model."""
        if self.series_order == 1:
            return "linear response"
        return f"load series to order {self.series_order}"
