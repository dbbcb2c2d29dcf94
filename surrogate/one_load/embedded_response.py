"""The linear response of a large body to one load, by way of the grid that is embedded in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.mechanics.kept_columns import LOADED, KeptColumns
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.networks.nodal_network import NodalNetwork

Single = NDArray[np.float32]


class EmbeddedResponse:
    """The linear response of a large body, by way of an embedded grid: (n_nodes, d) → same.

    Parameters
    ----------
    network : NodalNetwork
    linear : LinearResponse
        Its own.
    """

    def __init__(self, network: NodalNetwork, linear: LinearResponse) -> None:
        self.network, self.linear = network, linear
        d, nodes = len(network.network.displacement_scale), network.to_nodes.weights.shape[1]
        self.columns = KeptColumns(self.respond, nodes * d)

    def __call__(self, force: Single) -> Single:
        """Respond to forces in N by displacements in m."""
        flat = force.ravel()
        loaded = flat.nonzero()[0]
        few = len(loaded) <= LOADED
        u = flat[loaded] @ self.columns[loaded] if few else self.respond(flat[None])[0]
        return u.reshape(force.shape)

    @torch.inference_mode()
    def respond(self, forces: NDArray[Any]) -> Single:
        """Respond to several loads: (N, n_nodes · d) → same."""
        network, d = self.network, len(self.network.network.displacement_scale)
        nodal = torch.from_numpy(forces).reshape(len(forces), -1, d)
        displacement, _ = self.linear(network.on_grid(nodal))
        u = network.to_nodes((displacement * network.network.movable).flatten(2))
        found: Single = u.transpose(1, 2).flatten(1).numpy()
        return found
