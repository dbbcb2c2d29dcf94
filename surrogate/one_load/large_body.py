"""The linear response of a large body to one load or some, for reduced networks."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array

from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.kept_responses import LOADED, KeptResponses
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.series.series_response import SeriesResponse

Single = NDArray[np.float32]
Array = NDArray[np.float64]


class LargeBody:
    """Scaled forces on the grid, and the linear response at the nodes.

    A load on a few nodes is answered by columns of the response, which are kept: on a grid of
    nodes by `Compliance`, on an embedded grid, where the force of a node is distributed over many,
    here. There other loads are left to PyTorch, which takes as long for them.

    Parameters
    ----------
    network : NodalNetwork
    """

    def __init__(self, network: NodalNetwork) -> None:
        assert isinstance(network.network.linear, LinearResponse)
        self.network, self.linear = network, network.network.linear
        weights = network.to_grid.weights.numpy() / network.network.force_scale.numpy()
        count, points = weights.shape
        places = np.tile(np.arange(points), count), network.to_grid.sources.numpy()
        d, nodes = len(network.network.displacement_scale), network.to_nodes.weights.shape[1]
        self.to_grid = coo_array((weights.ravel(), places), shape=(points, nodes)).tocsr()
        maps = network.to_nodes, network.to_grid, self.linear.to_grid, self.linear.to_nodes
        self.compliance: Compliance | None = None
        if all(len(sums.weights) == 1 for sums in maps):
            assert isinstance(self.linear.compliance, Compliance)
            self.compliance = self.linear.compliance
        self.columns = KeptResponses(self._responses, nodes * d)

    @staticmethod
    def fits(network: NodalNetwork) -> bool:
        """Whether a network has no gradients as input, and adds to the linear response."""
        field = network.network
        linear = field.linear
        if not isinstance(linear, LinearResponse) or isinstance(linear, SeriesResponse):
            return False
        return field.skip and field.inputs == ("force",)

    def known(self, forces: Array) -> NDArray[np.bool_]:
        """All loads on a grid of nodes; those on a few nodes on an embedded grid."""
        if self.compliance is not None:
            return np.ones(len(forces), bool)
        loaded = np.count_nonzero(forces.reshape(len(forces), -1), axis=1)
        return loaded <= LOADED

    def __call__(self, forces: Array) -> tuple[Single, Array]:
        """Return inputs and response."""
        force = forces.astype(np.float32)
        inputs = np.stack([self.to_grid @ f for f in force])
        if self.compliance is not None:
            return inputs, self.compliance.respond_at_nodes(force).astype(np.float64)
        response = np.empty(forces.shape)
        for found, flat in zip(response, force.reshape(len(force), -1), strict=True):
            loaded = flat.nonzero()[0]
            found[:] = self.columns.sum_of(loaded, flat[loaded]).reshape(found.shape)
        return inputs, response

    @torch.inference_mode()
    def _responses(self, forces: NDArray[Any]) -> Single:
        """Responses to several loads: (N, n_nodes · d) → same."""
        network, movable = self.network, self.network.network.movable
        nodal = torch.from_numpy(forces).reshape(len(forces), -1, len(self.linear.shape))
        force = network.on_grid(nodal)
        linear = network.linear_response(force)
        displacement = self.linear(force)[0] if linear is None else self.linear.on_grid(linear)[0]
        u = network.at_nodes(displacement * movable, linear)
        return u.transpose(1, 2).flatten(1).numpy()
