"""The response of the body under one load or some, of surrogates that add nothing to it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.mechanics.linear_response import LinearResponse
from surrogate.networks.nodal_network import NodalNetwork
from surrogate.one_load.backend import TOGETHER
from surrogate.one_load.small_body import SmallSeries
from surrogate.series.series_response import SeriesResponse

Array = NDArray[np.float64]


class ResponseAlone:
    """Load series or linear response at the nodes.

    Parameters
    ----------
    network : NodalNetwork
        On the CPU; every node is a grid point, and nothing is added to the response.
    """

    def __init__(self, network: NodalNetwork) -> None:
        response = network.network.linear
        assert isinstance(response, LinearResponse)
        self.response, self.small = response, None
        if isinstance(response, SeriesResponse) and SmallSeries.fits(response):
            self.small = SmallSeries(response, len(response.shape))

    def several(self, forces: Array) -> tuple[Array, Array]:
        """Predict displacements, and tell how much the last term of the series changes them.

        Parameters
        ----------
        forces : array, (N, n_nodes, d)
            In N.

        Returns
        -------
        displacements : array, (N, n_nodes, d)
            In m.
        last : array, (N,)
            Largest displacement of the last term in m; infinite without a series.
        """
        if self.small is not None:
            displacements, _, last = self.small(forces)
            return displacements, last
        parts = np.split(forces, range(TOGETHER, len(forces), TOGETHER))
        found, sizes = zip(*map(self._large, parts), strict=True)
        return np.concatenate(found), np.concatenate(sizes)

    @torch.inference_mode()
    def _large(self, forces: Array) -> tuple[Array, Array]:
        nodal = torch.from_numpy(forces).transpose(1, 2)
        if not isinstance(self.response, SeriesResponse):
            found = self.response.respond(nodal.float())
            return found.transpose(1, 2).double().numpy(), np.full(len(forces), np.inf)
        first = self.response.respond(nodal.to(self.response.precision))
        beyond, term = self.response.beyond_first(first)
        last = term.square().sum(1).amax(1).sqrt().double().numpy()
        return (first + beyond).transpose(1, 2).double().numpy(), last
