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

from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.weighted_sums import padded_rows
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.series.load_threads import in_threads
from surrogate.series.series_response import SeriesResponse

MOST = 2**22  # values of a matrix: 16 MB
AT_ONCE = 256  # unit forces at once
OF_A_THREAD = 8  # loads of a series, at least
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
            if not SmallSeries.fits(linear) or any(len(sums.weights) > 1 for sums in maps):
                return False
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
            response, last, _ = self.series(forces)
            if self.last_gradient is not None:
                inputs[:, :, self.last_gradient] = last
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
    """What `SeriesResponse` finds, by a few matrices and one compiled function.

    Parameters
    ----------
    response : SeriesResponse
        Response of a body whose nodes are the grid points.
    dimension : int
        Number of space dimensions d.
    """

    def __init__(self, response: SeriesResponse, dimension: int) -> None:
        from surrogate.series import compiled_series, compiled_terms  # Numba: half a second

        d, size = dimension, dimension * response.nodes
        assert isinstance(response.compliance, Compliance)
        solid = response.compliance.equilibrium.solid
        self.order = response.order
        with torch.inference_mode():
            units = torch.eye(size).reshape(size, response.nodes, d).transpose(1, 2)
            gradients = np.zeros((size, 0))  # nothing needs them
            if len(response.derivatives):
                on_grid = response.first_on_grid(units)[1][:, : d * d] * response.gradient_rms
                gradients = _rows(on_grid.flatten(2).transpose(1, 2))
            self.operators = compiled_series.SmallOperators(
                response=_rows(response.respond(units.double()).transpose(1, 2)),
                body=compiled_series.SeriesBody.of(solid, np.float64),
                on_grid=_by_column(gradients.T),
            )
        self.find, self.room = compiled_series.small_series, compiled_terms.room_for_terms

    @staticmethod
    def fits(response: SeriesResponse) -> bool:
        """Whether matrix and fields of the body are small; needs Numba."""
        d, points = len(response.shape), response.higher.volumes.numel()
        size = response.nodes * d
        return response.compiled and max(size, points * d**2) * size <= MOST

    def __call__(self, forces: Array) -> tuple[Array, Array, Array]:
        """Return the displacements in m, gradient and size in m of the last term, of forces in N.

        (N, n_nodes, d) → same, (N, n_grid_points, d²), (N,)
        """
        u, lengths = np.empty(forces.shape), np.empty(len(forces))
        gradients = np.empty((len(forces), self.operators.on_grid[1].shape[1]))

        def find(some: slice) -> None:
            terms = self.room(1, self.order, self.operators.body.cells, self.operators.body.laws)
            found = self.find(forces[some], self.operators, terms)
            u[some], gradients[some], lengths[some] = found

        in_threads(find, len(forces), OF_A_THREAD)
        return u, gradients.reshape(len(forces), -1, forces.shape[-1] ** 2), lengths


def _by_column(matrix: NDArray[Any]) -> tuple[NDArray[np.int64], Array]:
    """Columns and weights of the entries of every row that are not zero, (k, n_out)."""
    columns, weights = padded_rows(csr_array(matrix))
    return np.ascontiguousarray(columns.T), np.ascontiguousarray(weights.T, np.float64)


def _rows(values: Tensor) -> NDArray[Any]:
    """Matrix of (n, …) values."""
    return np.ascontiguousarray(values.reshape(len(values), -1).numpy())
