"""No network: nothing is added to the response of the body."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class NoNetwork(nn.Module):
    """Zero displacements on the grid, of a surrogate that is the response of the body alone."""

    def forward(self, inputs: Tensor) -> Tensor:
        """Return zeros: (N, d, nx, ny[, nz]) → same."""
        return torch.zeros_like(inputs)
