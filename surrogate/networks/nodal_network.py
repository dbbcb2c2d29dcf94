"""A network that maps nodal fields of a mesh: a field network with maps to and from the grid."""

from __future__ import annotations

import numpy as np
from torch import Tensor, nn

from shared_schema.grid import Grid
from surrogate.mechanics.weighted_sums import WeightedSums, transposed
from surrogate.networks.field_network import FieldNetwork
from surrogate.probabilistic.likelihoods import Prediction


class NodalNetwork(nn.Module):
    """A network that maps nodal forces in N to nodal displacements in m.

    Nodal displacements are u = B U, from the displacements U on the grid. Forces on the grid are
    F = Bᵀ f, from the nodal forces f (`shared_schema.grid`).

    Parameters
    ----------
    network : FieldNetwork
    grid : Grid
    """

    def __init__(self, network: FieldNetwork, grid: Grid) -> None:
        super().__init__()
        self.network = network
        self.shape = grid.shape
        self.to_nodes = WeightedSums(grid.points, grid.point_weights)
        count = int(np.prod(grid.shape))
        self.to_grid = WeightedSums(*transposed(grid.points, grid.point_weights, count))

    def forward(self, force: Tensor, passes: int = 1, response: Tensor | None = None) -> Prediction:
        """Predict with one pass, or with several drawn passes (`probabilistic.stochastic_passes`).

        Parameters
        ----------
        force : Tensor, (N, n_nodes, d)
            Nodal forces in newtons.
        passes : int
            Number of drawn passes T.
        response : Tensor, (N, n_nodes, d), optional
            The linear response to these forces in m, if it is known; otherwise it is computed.

        Returns
        -------
        Prediction
            Fields (K·T, N, n_nodes, d) in m; K is the number of members of the ensemble.
        """
        by_component = None if response is None else response.transpose(1, 2)
        mean, std = self.network(self.on_grid(force), passes, by_component)

        def at_nodes(field: Tensor) -> Tensor:
            nodal = self.to_nodes(field.flatten(2)).transpose(1, 2)
            return nodal.reshape(self.network.members * passes, -1, *nodal.shape[1:])

        if std is None:
            return Prediction(at_nodes(mean), None)
        return Prediction(at_nodes(mean), at_nodes(std) * self.factors(force)[0])

    def on_grid(self, force: Tensor) -> Tensor:
        """Map nodal forces to the grid: (N, n_nodes, d) → (N, d, nx, ny[, nz])."""
        grid = self.to_grid(force.transpose(1, 2))
        return grid.reshape(*grid.shape[:2], *self.shape)

    def factors(self, force: Tensor) -> tuple[Tensor, Tensor]:
        r"""Return the factors on aleatoric and epistemic standard deviations, (N, 1, 1) each.

        They depend on the forces: :math:`(a c)^w, (b c)^w`, where c depends on the number of loaded
        nodes, :math:`w = \min(1, r^{-4})`, and r is the ratio of the largest force component to the
        largest one in training. So they are the fitted factors inside the training range, and tend
        to 1 outside it.
        """
        limit = self.network.force_scale * 3**0.5  # largest force component in training
        reach = force.abs().amax(dim=(1, 2), keepdim=True) / limit
        weight = reach.clamp(min=1).pow(-4)
        network, c = self.network, self.network.count_factor(force)[:, None, None]
        return (network.aleatoric_factor * c) ** weight, (network.epistemic_factor * c) ** weight
