"""The terms of second and third order of a small body in NumPy, for one load at a time."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.series_response import SeriesResponse

Single = NDArray[np.float32]


class SeriesInNumPy:
    """u₂ + u₃ of u₁, and their gradient on the grid, by dense matrices.

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
        self.stress = response.higher.stress
        self.identity = np.eye(d, dtype=np.float32)
        with torch.inference_mode():
            units = torch.eye(size).reshape(size, response.nodes, d).transpose(1, 2)
            slopes = response.higher.gradient(units)
            self.slopes = _rows(slopes.transpose(0, 1))
            self.shape = slopes.shape[0], *slopes.shape[2:]
            count = int(np.prod(self.shape))
            stresses = torch.eye(count).reshape(count, *self.shape).transpose(0, 1)
            self.answers = _rows(response.balanced(stresses.contiguous()).transpose(1, 2))
            scale = response.gradient_rms / response.series_rms
            gradients = response.first_on_grid(units)[1][:, : d * d] * scale
            self.gradients = _rows(gradients.flatten(2).transpose(1, 2))

    def __call__(self, first: Single) -> tuple[Single, Single]:
        """Return u₂ + u₃ in m, (n_nodes, d), and their gradients, (n_grid_points, d²)."""
        u = first.ravel()
        a = (u @ self.slopes).reshape(self.shape)
        second = self.stress.second(a, self.identity).ravel() @ self.answers
        b = (second @ self.slopes).reshape(self.shape)
        third = self.stress.third(a, b, self.identity).ravel() @ self.answers
        beyond: Single = second + third
        gradient: Single = (beyond @ self.gradients).reshape(-1, self.identity.size)
        return beyond.reshape(first.shape), gradient


def _rows(values: Tensor) -> Single:
    """Matrix of (n, …) values."""
    return np.ascontiguousarray(values.reshape(len(values), -1).numpy(), np.float32)
