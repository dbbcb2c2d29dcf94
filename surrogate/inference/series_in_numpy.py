"""The higher terms of the load series of a small body in NumPy, for one load at a time."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.series.series_response import SeriesResponse
from surrogate.mechanics.series.series_stress import SeriesStress, beyond_first

Single = NDArray[np.float32]


class SeriesInNumPy:
    """u₂ + u₃ + … of u₁, and their gradient on the grid, by dense matrices.

    Parameters
    ----------
    response : SeriesResponse
        Response of a body whose nodes are the grid points.
    dimension : int
        Number of space dimensions d.

    Attributes
    ----------
    slopes : array, (n_dofs, n_cells · n_points · d²)
        Displacements of the nodes to their gradients at the quadrature points.
    answers : array, (n_cells · n_points · d², n_dofs)
        Stresses there to the displacements that balance them.
    gradients : array, (n_dofs, n_grid_points · d²)
        Displacements to their scaled gradients on the grid.
    """

    def __init__(self, response: SeriesResponse, dimension: int) -> None:
        d, size = dimension, dimension * response.nodes
        self.material, self.order = response.higher.material, response.order
        with torch.inference_mode():
            units = torch.eye(size).reshape(size, response.nodes, d).transpose(1, 2)
            slopes = response.higher.gradient(units)
            self.slopes = _rows(slopes.permute(3, 0, 1, 2, 4))
            self.shape = d, d, slopes.shape[2] * slopes.shape[4]
            count = int(np.prod(self.shape))
            stresses = torch.eye(count).reshape(count, d, d, slopes.shape[2], slopes.shape[4])
            stresses = stresses.permute(1, 2, 3, 0, 4)
            self.answers = _rows(response.balanced(stresses).transpose(1, 2))
            scale = response.gradient_rms / response.series_rms
            gradients = response.first_on_grid(units)[1][:, : d * d] * scale
            self.gradients = _rows(gradients.flatten(2).transpose(1, 2))

    def __call__(self, first: Single) -> tuple[Single, Single]:
        """Return u₂ + u₃ + … in m, (n_nodes, d), and their gradients, (n_grid_points, d²)."""
        series = SeriesStress(self.material, self._gradient(first.ravel()))
        beyond: Single = beyond_first(series, self.order, self._gradient, self._balanced)
        gradient: Single = (beyond @ self.gradients).reshape(-1, first.shape[1] ** 2)
        return beyond.reshape(first.shape), gradient

    def _gradient(self, u: Single) -> Single:
        """Gradients at the quadrature points: (n_dofs,) → (d, d, n_cells · n_points)."""
        return (u @ self.slopes).reshape(self.shape)

    def _balanced(self, stress: Single) -> Single:
        """Displacements that balance stresses: (d, d, n_cells · n_points) → (n_dofs,)."""
        u: Single = stress.ravel() @ self.answers
        return u


def _rows(values: Tensor) -> Single:
    """Matrix of (n, …) values."""
    return np.ascontiguousarray(values.reshape(len(values), -1).numpy(), np.float32)
