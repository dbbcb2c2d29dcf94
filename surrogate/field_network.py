"""A network between fields in SI units: scaling in, scaling out, zero where nothing can move."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from shared_schema.manifest import StructuredInfo
from surrogate.geometry import Geometry


class FieldNetwork(nn.Module):
    """Nodal forces in N to nodal displacements in m, on the grid.

    One scale serves all components of a field, so that the loss weighs them as ē does.

    Parameters
    ----------
    network : nn.Module
        Between scaled fields, (N, d, nx, ny[, nz]) → (N, d, nx, ny[, nz]).
    geometry : Geometry
        Grid points that are clamped, or no nodes, are given zero displacement.
    info : StructuredInfo
        Statistics of the training split, for the scales.
    """

    force_scale: Tensor
    displacement_scale: Tensor
    free: Tensor

    def __init__(self, network: nn.Module, geometry: Geometry, info: StructuredInfo) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("force_scale", torch.tensor(max(info.force.max_abs) / math.sqrt(3)))
        self.register_buffer("displacement_scale", torch.tensor(_rms(info)))
        self.register_buffer("free", torch.from_numpy(geometry.free_mask).float())

    def forward(self, force: Tensor) -> Tensor:
        """Predict displacements in m from forces in N."""
        scaled: Tensor = self.network(force / self.force_scale)
        return scaled * self.free * self.displacement_scale


def _rms(info: StructuredInfo) -> float:
    """Root mean square of the displacement over nodes and components, in m."""
    squares = [
        m**2 + s**2 for m, s in zip(info.displacement.mean, info.displacement.std, strict=True)
    ]
    return math.sqrt(sum(squares) / len(squares)) or 1.0
