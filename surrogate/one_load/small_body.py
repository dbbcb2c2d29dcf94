"""Everything before the network under one load on a small body, by a few matrices.

Network inputs and linear response are linear in the forces, so that one matrix has them, found by
unit forces. The terms of a load series follow from the linear response by loops that Numba compiles
(`surrogate.series.compiled_series`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor

from surrogate.mechanics.weighted_sums import padded_rows
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.series.series_response import SeriesResponse

MOST = 2**22  # values of a matrix: 16 MB
AT_ONCE = 256  # unit forces at once
Single = NDArray[np.float32]
Array = NDArray[np.float64]


class SmallBody:
    """Inputs of the network and response of the body.

    Parameters
    ----------
    network : NodalNetwork

    Attributes
    ----------
    matrix : array, (n_nodes · d, n_points · inputs [+ n_nodes · d])
        Forces in N to the inputs of the network, then, if its output is added to the linear
        response, to displacements in m.
    series : SmallSeries or None
        What finds the response and the gradient of the last term in a load series.
    """

    at_once = 16  # their fields stay in the cache

    def __init__(self, network: NodalNetwork) -> None:
        field = network.network
        self.last_gradient, self.points = field.last_gradient, field.free.numel()
        d, nodes = len(field.displacement_scale), network.to_nodes.weights.shape[1]
        series = field.linear if isinstance(field.linear, SeriesResponse) else None
        self.series = None if series is None else SmallSeries(series, d)
        self.inputs = input_values(network)
        units = torch.split(torch.eye(nodes * d).reshape(-1, nodes, d), AT_ONCE)
        with torch.inference_mode():
            self.matrix = torch.cat([linear_part(network, force) for force in units]).numpy()

    @staticmethod
    def fits(network: NodalNetwork) -> bool:
        """Whether the matrices are small; a load series needs Numba and a grid of nodes."""
        field, size = network.network, network.to_nodes.weights.shape[1]
        size *= len(field.displacement_scale)
        values = input_values(network) + size * field.skip
        linear = field.linear
        if isinstance(linear, SeriesResponse):
            maps = network.to_nodes, network.to_grid, linear.to_grid, linear.to_nodes
            if not linear.compiled or any(len(sums.weights) > 1 for sums in maps):
                return False
            values = max(values, linear.higher.volumes.numel() * len(linear.shape) ** 2)
        return values * size <= MOST

    def known(self, forces: Array) -> NDArray[np.bool_]:
        """All loads."""
        return np.ones(len(forces), bool)

    def __call__(self, forces: Array) -> tuple[Single, Array | None]:
        """Return inputs and response; sparse loads need only some rows of the matrix."""
        flat, matrix = forces.reshape(len(forces), -1).astype(np.float32), self.matrix
        loaded = np.flatnonzero(flat.any(axis=0))
        if 4 * len(loaded) < len(matrix):
            flat, matrix = flat[:, loaded], matrix[loaded]
        found = flat @ matrix
        inputs = found[:, : self.inputs].reshape(len(forces), self.points, -1)
        if self.series is not None:
            response, inputs[..., self.last_gradient] = self.series(forces)
            return inputs, response
        if len(found[0]) == self.inputs:
            return inputs, None
        return inputs, found[:, self.inputs :].reshape(forces.shape).astype(np.float64)


def input_values(network: NodalNetwork) -> int:
    """Number of inputs of a network at all grid points."""
    field = network.network
    return field.free.numel() * max(channels.stop for channels in field.channels.values())


def linear_part(network: NodalNetwork, force: Tensor) -> Tensor:
    """Return what is linear in the forces: (N, n_nodes, d) in N → (N, columns of the matrix)."""
    field, on_grid = network.network, network.on_grid(force)
    linear, displacement, nodal = field.linear, None, network.linear_response(on_grid)
    if isinstance(linear, SeriesResponse):
        _, gradient = linear.first_on_grid(linear.at_nodes(on_grid))
        parts = [field.inputs_with(on_grid, gradient)]
    else:
        inputs, displacement = field.inputs_of(on_grid, nodal)
        parts = [field.scaled(inputs)]
    if displacement is not None:
        parts.append(network.at_nodes(displacement * field.movable, nodal))
    return torch.cat([part.flatten(2).transpose(1, 2).flatten(1) for part in parts], dim=1)


class SmallSeries:
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
        from surrogate.series import compiled_fields, compiled_series  # Numba: half a second

        self.weighted_sums = compiled_fields.weighted_sums
        self.beyond_linear = compiled_series.beyond_linear_of_some
        d, size = dimension, dimension * response.nodes
        self.material, self.order = response.higher.material, response.order
        self.shares = response.higher.shares.numpy()
        with torch.inference_mode():
            units = torch.eye(size).reshape(size, response.nodes, d).transpose(1, 2)
            slopes = response.higher.gradient(units.to(response.higher.slopes.dtype))
            of_slopes, self.shape = _rows(slopes).T, slopes.shape[1:]
            volumes = np.tile(response.higher.volumes.numpy(), d * d)[:, None]
            self.slopes = _by_column(csr_array(of_slopes))
            self.forces = _by_column(csr_array((of_slopes * volumes).T))
            balancing = -response.respond(units.double())
            self.response = _rows(balancing.transpose(1, 2))
            gradients = response.first_on_grid(units)[1][:, : d * d] * response.gradient_rms
            self.gradients = _rows(gradients.flatten(2).transpose(1, 2))

    def __call__(self, forces: Array) -> tuple[Array, Single]:
        """Return the displacements in m and the gradient of the last term, of forces in N.

        (N, n_nodes, d) → same, (N, n_grid_points, d²)
        """
        flat = forces.reshape(len(forces), -1)
        loaded = np.flatnonzero(flat.any(axis=0))
        first = -(flat[:, loaded] @ self.response[loaded])
        beyond, last = self.beyond_linear(
            self.material, self.shares, self.order, first, self._gradient, self._balanced
        )
        gradient = last.astype(np.float32) @ self.gradients
        return (first + beyond).reshape(forces.shape), gradient.reshape(
            len(forces), -1, forces.shape[-1] ** 2
        )

    def _gradient(self, u: Array) -> Array:
        """Gradients at the quadrature points: (n_dofs,) → (d, d, n_cells · n_points)."""
        return self.weighted_sums(*self.slopes, u).reshape(self.shape)

    def _balanced(self, stresses: list[Array]) -> Array:
        """Displacements that balance stresses: N of (d, d, n_cells · n_points) → (N, n_dofs)."""
        forces = [self.weighted_sums(*self.forces, stress.ravel()) for stress in stresses]
        return np.stack(forces) @ self.response.T


def _by_column(matrix: csr_array) -> tuple[NDArray[np.int64], Array]:
    """Columns and weights of every row, (k, n_out)."""
    columns, weights = padded_rows(matrix)
    return np.ascontiguousarray(columns.T), np.ascontiguousarray(weights.T)


def _rows(values: Tensor) -> NDArray[Any]:
    """Matrix of (n, …) values."""
    return np.ascontiguousarray(values.reshape(len(values), -1).numpy())
