"""A network that maps nodal fields of a mesh: a field network with maps to and from the grid."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from shared_schema.grid import Grid
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.held_nodes import HeldNodes
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.mechanics.matrices.sparse_products import WeightedSums, matrix_of


class NodalNetwork(nn.Module):
    """A network that maps nodal forces in N to nodal displacements in m.

    Nodal displacements are u = B U, from the displacements U on the grid. Forces on the grid are
    F = Bᵀ f, from the nodal forces f (`shared_schema.grid`). On an embedded grid, where a node's
    displacement is interpolated, supports are held at the nodes, and a linear response in U is
    taken at the nodes, where it is exact (`at_nodes`).

    Parameters
    ----------
    network : FieldNetwork
    grid : Grid
    held : HeldNodes, optional
        Supports of a body on an embedded grid.
    """

    def __init__(self, network: FieldNetwork, grid: Grid, held: HeldNodes | None = None) -> None:
        super().__init__()
        self.network, self.held = network, held
        self.shape = grid.shape
        to_nodes = matrix_of(grid.points, grid.point_weights, int(np.prod(grid.shape)))
        self.to_nodes, self.to_grid = WeightedSums(to_nodes), WeightedSums(to_nodes.T.tocsr())

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
        grid, linear = self.on_grid(force), None
        if response is not None:
            linear = response.transpose(1, 2)
        elif self.held is not None:
            linear = self.linear_response(grid)
        mean, std = self.network(grid, passes, linear)
        count = self.network.members * passes

        def by_pass(nodal: Tensor) -> Tensor:
            return nodal.transpose(1, 2).reshape(count, *force.shape)

        found = by_pass(self.at_nodes(mean, linear))
        if std is None:
            return Prediction(found, None)
        spread = self.to_nodes(std.flatten(2))
        if self.held is not None:
            spread = spread * self.held.share
        return Prediction(found, by_pass(spread) * self.factors(force)[0])

    def linear_response(self, grid: Tensor) -> Tensor | None:
        """Linear response in m to forces on the grid, (N, d, n_nodes), if the network adds to it.

        None if the network does not, or every node is a grid point, so that nothing needs it.
        """
        adds = self.held is not None and self.network.skip
        linear = self.network.linear if adds else None
        return None if linear is None else linear.at_nodes(grid)

    def at_nodes(self, fields: Tensor, linear: Tensor | None = None) -> Tensor:
        """Take displacements on the grid to the nodes: (M, d, nx, ny[, nz]) → (M, d, n_nodes).

        Parameters
        ----------
        fields : Tensor, (M, d, nx, ny[, nz])
            In m; M = K·T·N of N samples.
        linear : Tensor, (N, d, n_nodes), optional
            The linear response that they contain, if they do. On an embedded grid it takes the
            place of its interpolation, :math:`B U + (1 - B A) u_{lin}`.
        """
        nodal = self.to_nodes(fields.flatten(2))
        if self.held is None:
            return nodal
        if linear is not None and self.network.skip:
            assert self.network.linear is not None
            single = linear.float()
            rest = single - self.to_nodes(self.network.linear.to_grid(single))
            nodal = nodal + rest.repeat(nodal.shape[0] // max(rest.shape[0], 1), 1, 1)
        return torch.as_tensor(self.held(nodal))

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
