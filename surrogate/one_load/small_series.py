"""The response of a small body beyond the linear one, compiled, for one load at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor

from surrogate.mechanics.weighted_sums import padded_rows
from surrogate.series.compiled_best_response import beyond_linear_of_one
from surrogate.series.compiled_fields import weighted_sums
from surrogate.series.series_response import SeriesResponse

Single = NDArray[np.float32]
Array = NDArray[np.float64]


class CompiledSeries:
    """What `SeriesResponse` finds, by a few matrices.

    Parameters
    ----------
    response : SeriesResponse
        Response of a body whose nodes are the grid points.
    dimension : int
        Number of space dimensions d.

    Attributes
    ----------
    slopes : tuple of array, (k, d² · n_points) each
        Sources and weights, from displacements of the nodes to their gradients at the quadrature
        points.
    forces : tuple of array, (k, n_dofs) each
        From stresses there to their forces.
    response : array, (n_dofs, n_dofs)
        Forces to the displacements that balance them.
    gradients : array, (n_dofs, n_grid_points · d²)
        Displacements to their gradients on the grid.
    """

    def __init__(self, response: SeriesResponse, dimension: int) -> None:
        d, size = dimension, dimension * response.nodes
        self.material, self.order = response.higher.material, response.order
        self.volumes = response.higher.volumes.numpy()
        with torch.inference_mode():
            units = torch.eye(size).reshape(size, response.nodes, d).transpose(1, 2)
            slopes = response.higher.gradient(units.double())
            of_slopes, self.shape = _rows(slopes).T, slopes.shape[1:]
            volumes = np.tile(self.volumes, d * d)[:, None]
            self.slopes = _by_column(csr_array(of_slopes))
            self.forces = _by_column(csr_array((of_slopes * volumes).T))
            balancing = -response.respond(units.double())
            self.response = _rows(balancing.transpose(1, 2))
            gradients = response.first_on_grid(units)[1][:, : d * d] * response.gradient_rms
            self.gradients = _rows(gradients.flatten(2).transpose(1, 2))

    def __call__(self, force: Array) -> tuple[Array, Single]:
        """Return the displacements in m and the gradient of the last term, of forces in N.

        (n_nodes, d) → same, (n_grid_points, d²)
        """
        flat = force.ravel()
        loaded = flat.nonzero()[0]
        first = -(flat[loaded] @ self.response[loaded])
        beyond, last = beyond_linear_of_one(
            self.material, self.volumes, self.order, first, self._gradient, self._balanced
        )
        d = force.shape[1]
        gradient: Single = last.astype(np.float32) @ self.gradients
        return (first + beyond).reshape(force.shape), gradient.reshape(-1, d * d)

    def _gradient(self, u: Array) -> Array:
        """Gradients at the quadrature points: (n_dofs,) → (d, d, n_cells · n_points)."""
        slopes: Array = weighted_sums(*self.slopes, u).reshape(self.shape)
        return slopes

    def _balanced(self, stress: Array) -> Array:
        """Displacements that balance stresses: (d, d, n_cells · n_points) → (n_dofs,)."""
        u: Array = self.response @ weighted_sums(*self.forces, stress.ravel())
        return u


def _by_column(matrix: csr_array) -> tuple[NDArray[np.int64], Array]:
    """Columns and weights of every row, (k, n_out)."""
    columns, weights = padded_rows(matrix)
    return np.ascontiguousarray(columns.T), np.ascontiguousarray(weights.T)


def _rows(values: Tensor) -> NDArray[Any]:
    """Matrix of (n, …) values."""
    return np.ascontiguousarray(values.reshape(len(values), -1).numpy())
