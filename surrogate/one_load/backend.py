"""Prediction of the displacements under one load in NumPy, where PyTorch's calls take most time.

Everything before a network's first layer is linear in the forces: forces on the grid, linear
response, gradient, scales; the higher terms of a load series follow from it (`compiled_series`). On
small bodies it is one matrix, found by unit forces. On large bodies it is computed by PyTorch; for
a reduced network, and on a grid of nodes with a load series (`large_series`), by columns that are
kept.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from torch import Tensor, nn

from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.weighted_sums import WeightedSums
from surrogate.networks.field_network import TINY
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.networks.reduced_network import ReducedNetwork
from surrogate.networks.unet import UNet
from surrogate.one_load.dense_in_numpy import ReducedInNumPy
from surrogate.one_load.embedded_response import EmbeddedResponse
from surrogate.one_load.unet_in_numpy import UNetInNumPy
from surrogate.probabilistic.ensemble import Ensemble
from surrogate.series import series_response
from surrogate.series.series_response import SeriesResponse

if TYPE_CHECKING:
    from surrogate.one_load.large_series import LargeSeries
    from surrogate.one_load.small_series import CompiledSeries

LARGEST = 2**22  # values of the matrix: 16 MB
AT_ONCE = 256  # unit forces at once
SMALLEST = np.float32(TINY)
Single = NDArray[np.float32]
Array = NDArray[np.float64]
GridFunction = Callable[[Single], Single]  # (n_points, inputs) to (n_points, outputs)


class OneLoad:
    """The mean displacements under one load.

    Parameters
    ----------
    network : NodalNetwork
        Network on the CPU that is not stochastic; its weights are copied.
    members : list of callable
        Its networks on the grid, from `in_numpy`.
    """

    def __init__(self, network: NodalNetwork, members: list[GridFunction]) -> None:
        self.network, self.members = network, members
        self.points, self.foretold = network.network.free.numel(), network.network.foretold
        field, weights = network.network, network.to_nodes.weights.numpy()  # (k, n_nodes)
        d, self.nodes = len(field.displacement_scale), weights.shape[1]
        scale = (field.displacement_scale * field.movable).reshape(d, -1).numpy().T
        self.sources = network.to_nodes.sources.numpy().reshape(weights.shape)
        self.scales = weights[:, :, None] * scale[self.sources] / np.float32(len(members))
        self.to_grid = matrix_of(network.to_grid, self.nodes)
        self.to_grid.data /= field.force_scale.numpy()
        self.response = response_at_nodes(network)
        self.series, self.large = series_at_nodes(network)
        self.matrix: Single | None = None
        self.inputs = 0  # of the network, among the values of `linear_part`
        if self.large is not None:
            return
        with torch.inference_mode():
            values = self.linear_part(torch.zeros(1, self.nodes, d)).numel()
            has_response = field.skip and self.series is None
            self.inputs = values - self.nodes * d if has_response else values
            nonlinear = isinstance(field.linear, SeriesResponse) and self.series is None
            if values * self.nodes * d <= LARGEST and not nonlinear:
                units = torch.split(torch.eye(self.nodes * d).reshape(-1, self.nodes, d), AT_ONCE)
                self.matrix = torch.cat([self.linear_part(force) for force in units]).numpy()

    def __call__(self, forces: Array) -> Array:
        """Predict displacements in m from forces in N, both (n_nodes, d)."""
        force, response = forces.astype(np.float32), None
        if self.large is not None:
            response, gradients = self.large(forces)
            fields, linear = self._joined(force, gradients), gradients[:0]
        else:
            linear = self._linear_part(force)
            fields = linear[: self.inputs].reshape(self.points, -1)
        if self.series is not None:
            response, fields[:, self.foretold] = self.series(forces)
        if self.foretold is not None:
            last = fields[:, self.foretold]
            amplitude = np.sqrt((last * last).sum(axis=1).max())
            last /= amplitude + SMALLEST
        y = self.members[0](fields)
        for member in self.members[1:]:
            y += member(fields)
        if self.foretold is not None:
            y *= amplitude
        u = y.take(self.sources, axis=0) * self.scales
        nodal = u[0] if len(u) == 1 else u.sum(axis=0)
        if len(linear) > self.inputs:
            nodal += linear[self.inputs :].reshape(nodal.shape)
        displacement: Array = nodal.astype(np.float64)
        return displacement if response is None else displacement + response

    def _linear_part(self, force: Single) -> Single:
        """Return `linear_part` of one load; a sparse load needs only some rows of the matrix."""
        if self.matrix is None:
            if self.response is not None:
                u = self.response(force)
                return np.concatenate((self._on_grid(force).ravel(), u.ravel()))
            with torch.inference_mode():
                part: Single = self.linear_part(torch.from_numpy(force[None]))[0].numpy()
            return part
        flat, matrix = force.ravel(), self.matrix
        loaded = flat.nonzero()[0]
        if 4 * len(loaded) < len(flat):
            flat, matrix = flat[loaded], matrix[loaded]
        found: Single = flat @ matrix
        return found

    def _joined(self, force: Single, gradients: Single) -> Single:
        """Inputs at the grid points, by their names: (n_points, d), (n_points, 2 d²) → …."""
        channels = gradients.shape[1] // 2
        fields = {"force": self._on_grid(force), "linear_gradient": gradients[:, :channels]}
        fields["last_gradient"] = gradients[:, channels:]
        return np.concatenate([fields[name] for name in self.network.network.inputs], axis=1)

    def _on_grid(self, force: Single) -> Single:
        """Scaled forces on the grid: (n_nodes, d) → (n_points, d)."""
        scaled: Single = self.to_grid @ force
        return scaled

    def linear_part(self, force: Tensor) -> Tensor:
        """Return the network's inputs and, where its output is added to it, the linear response.

        Without what `series` finds, if it does.

        Parameters
        ----------
        force : Tensor, (N, n_nodes, d)
            In N.

        Returns
        -------
        Tensor, (N, n_points · inputs) or (N, n_points · inputs + n_nodes · d)
            Inputs at the grid points, scaled but for the gradient of a series' last term, then
            displacements of the nodes in m.
        """
        field = self.network.network
        on_grid, linear = self.network.on_grid(force), field.linear
        if self.series is None:
            inputs, displacement = field.inputs_of(on_grid)
        else:
            assert isinstance(linear, SeriesResponse)
            _, gradient = linear.first_on_grid(linear.at_nodes(on_grid))
            inputs, displacement = field.inputs_with(on_grid, gradient), None
        parts = [field.scaled(inputs) if field.foretold is None else inputs]
        if displacement is not None:
            parts.append(self.network.to_nodes((displacement * field.movable).flatten(2)))
        return torch.cat([p.flatten(2).transpose(1, 2).flatten(1) for p in parts], dim=1)


def response_at_nodes(network: NodalNetwork) -> Callable[[Single], Single] | None:
    """The linear response of a large body at its nodes, for a network without gradients.

    None for all other networks.
    """
    field = network.network
    linear = field.linear
    maps = network.to_nodes, network.to_grid
    if not isinstance(linear, LinearResponse) or isinstance(linear, SeriesResponse):
        return None
    if not field.skip or field.inputs != ("force",):
        return None
    found = linear.compliance
    if not isinstance(found, Compliance) or len(found.matrix):
        return None
    if all(len(sums.weights) == 1 for sums in (*maps, linear.to_grid, linear.to_nodes)):
        return found.respond_at_nodes
    embedded = EmbeddedResponse(network, linear)
    return embedded if embedded.columns.fit else None


def matrix_of(sums: WeightedSums, columns: int) -> csr_array:
    """Return weighted sums of some inputs as a sparse matrix."""
    count, rows = sums.weights.shape
    places = np.tile(np.arange(rows), count), sums.sources.numpy()
    return coo_array((sums.weights.numpy().ravel(), places), shape=(rows, columns)).tocsr()


def series_at_nodes(
    network: NodalNetwork,
) -> tuple[CompiledSeries | None, LargeSeries | None]:
    """The load series of a small or a large body whose nodes are the grid points.

    None for all other networks, and where Numba is missing.
    """
    linear = network.network.linear
    if not isinstance(linear, SeriesResponse) or not series_response.COMPILES:
        return None, None
    maps = network.to_nodes, network.to_grid, linear.to_grid, linear.to_nodes
    if any(len(sums.weights) > 1 for sums in maps):
        return None, None
    d = len(network.network.displacement_scale)
    size = linear.higher.weighted.numel() // linear.higher.weighted.shape[2] * d
    if size * d * linear.nodes > LARGEST:
        if not len(linear.derivatives):
            return None, None
        from surrogate.one_load.large_series import LargeSeries  # Numba: half a second

        return None, LargeSeries(linear)
    from surrogate.one_load.small_series import CompiledSeries

    return CompiledSeries(linear, d), None


def in_numpy(network: nn.Module, shape: tuple[int, ...], outputs: int) -> list[GridFunction] | None:
    """Copy the members of a network as functions on the grid; None if its kind has no such form.

    Parameters
    ----------
    network : nn.Module
        Network without random weights or masks.
    shape : tuple of int
        Number of grid points along every axis.
    outputs : int
        Number of output channels to compute, the first ones.
    """
    if isinstance(network, ReducedNetwork):
        return [ReducedInNumPy(network, shape)]
    members = list(network.members) if isinstance(network, Ensemble) else [network]
    unets = [member for member in members if isinstance(member, UNet)]
    if len(unets) < len(members):
        return None
    return [UNetInNumPy(unet, shape, outputs) for unet in unets]
