r"""The linear response of the undeformed body to forces on the grid.

.. math:: U_{lin} = A K^{-1} A^T F

K is the stiffness of the undeformed body with its supports. A takes nodal displacements to the grid
(`shared_schema.grid`), and its transpose takes forces from the grid to nodes with the same work. On
a grid whose points are nodes this is :math:`u_{lin} = K^{-1} f` itself. On an embedded grid the
force of a grid point is distributed over the nodes around it.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from shared_schema.stiffness import Stiffness
from surrogate.baselines.fitted import Fitted
from surrogate.baselines.linear_map import compliance_of
from surrogate.data.geometry import Geometry
from surrogate.mechanics.nodal_gradient import nodal_gradient
from surrogate.networks.weighted_sums import WeightedSums, padded_rows, transposed

MOST = 4000  # free degrees of freedom: the dense compliance then takes 64 MB


class LinearResponse(Fitted):
    """Grid forces in N to the linear response in m and its gradient, both on the grid.

    Parameters
    ----------
    geometry : Geometry

    Attributes
    ----------
    compliance : Tensor, (d · n_free, d · n_free)
        K⁻¹ in m/N over the free degrees of freedom, component by component; empty until `fit`.
    gradient_rms : Tensor, ()
        Root mean square of the gradients under the training forces.
    """

    compliance: Tensor
    gradient_rms: Tensor
    free_nodes: Tensor

    def __init__(self, geometry: Geometry) -> None:
        super().__init__("compliance", "gradient_rms")
        grid, self.nodes = geometry.grid, len(geometry.coordinates)
        self.shape = grid.shape
        free = np.flatnonzero(~geometry.clamped)
        self.register_buffer("free_nodes", torch.from_numpy(free), persistent=False)
        sources = np.maximum(grid.sources, 0).reshape(-1, grid.sources.shape[-1])
        weights = grid.source_weights.reshape(sources.shape)
        self.to_grid = WeightedSums(sources, weights)
        self.to_nodes = WeightedSums(*transposed(sources, weights, self.nodes))
        operators = nodal_gradient(geometry.coordinates, geometry.cells, geometry.cell_type)
        self.derivatives = torch.nn.ModuleList(
            WeightedSums(*padded_rows(operator)) for operator in operators
        )

    @torch.no_grad()
    def fit(self, stiffness: Stiffness, force: Tensor) -> None:
        """Invert the stiffness, and measure the gradients.

        Parameters
        ----------
        stiffness : Stiffness
            Stiffness of the whole body, without supports.
        force : Tensor, (N, d, nx, ny[, nz])
            Forces of the training samples in N.
        """
        compliance = compliance_of(stiffness, self.free_nodes.numpy(), self.nodes)
        self.compliance = compliance.to(force.dtype)
        self.gradient_rms = torch.ones((), dtype=force.dtype)
        _, gradient = self(force)
        rms = gradient.square().mean().sqrt()
        self.gradient_rms = torch.where(rms > 0, rms, torch.ones_like(rms))

    def forward(self, force: Tensor) -> tuple[Tensor, Tensor]:
        """Respond to forces.

        Parameters
        ----------
        force : Tensor, (N, d, nx, ny[, nz])
            In N.

        Returns
        -------
        displacement : Tensor, (N, d, nx, ny[, nz])
            U_lin in m; zero where the grid has no value.
        gradient : Tensor, (N, d², nx, ny[, nz])
            ∂u_lin,i / ∂x_j over `gradient_rms`, channel i + d j.
        """
        with torch.autocast(force.device.type, enabled=False):
            at_free = self.to_nodes(force.flatten(2)).index_select(2, self.free_nodes)
            u = functional.linear(at_free.flatten(1), self.compliance).reshape(at_free.shape)
            nodal = u.new_zeros(*u.shape[:2], self.nodes).index_copy(2, self.free_nodes, u)
            gradient = torch.cat([operator(nodal) for operator in self.derivatives], dim=1)
            fields = torch.cat([nodal, gradient / self.gradient_rms], dim=1)
            grid = self.to_grid(fields).reshape(force.shape[0], -1, *self.shape)
        d = force.shape[1]
        return grid[:, :d], grid[:, d:]
