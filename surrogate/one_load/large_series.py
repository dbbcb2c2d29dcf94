"""The load series of a large body whose nodes are the grid points, compiled, for one load."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.weighted_sums import WeightedSums
from surrogate.series.compiled_fields import slopes_at_points
from surrogate.series.series_response import SeriesResponse

Values = NDArray[Any]
Single = NDArray[np.float32]


class LargeSeries:
    """What `SeriesResponse` finds, cell by cell.

    Parameters
    ----------
    response : SeriesResponse
        Response of the body, on the CPU.
    """

    def __init__(self, response: SeriesResponse) -> None:
        assert isinstance(response.compliance, Compliance)
        self.compliance, self.beyond = response.compliance, response.of_one
        self.precision = response.higher.volumes.numpy().dtype
        self.rms = np.float32(response.gradient_rms)
        nodes, of_points = response.to_grid.sources, response.to_grid.weights[0]  # 0: no node
        of_axes = [of for of in response.derivatives if isinstance(of, WeightedSums)]
        weights = torch.stack([of.weights for of in of_axes], dim=2)  # (k, n_nodes, d)
        columns = of_axes[0].sources.reshape(weights.shape[:2])  # the same nodes for all axes
        self.columns = columns[:, nodes].T.contiguous().numpy()
        self.weights = (weights[:, nodes] * of_points[:, None]).swapaxes(0, 1).contiguous().numpy()

    def __call__(self, force: NDArray[np.float64]) -> tuple[Values, Single]:
        """Return the displacements in m, and gradients of u₁ over its scale and of the last term.

        (n_nodes, d) in N → same, (n_grid_points, 2 d²)
        """
        first = self.compliance.respond_at_nodes(force.astype(self.precision))
        beyond, last = self.beyond(first)
        slopes = [
            slopes_at_points(self.columns, self.weights, u.astype(np.float32))
            for u in (first / self.rms, last)
        ]
        return first + beyond, np.concatenate(slopes, axis=1)
