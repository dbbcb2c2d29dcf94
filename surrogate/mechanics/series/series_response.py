r"""The response of the body to forces on the grid, to some order in the load.

.. math::
    U = A \sum_{k=1}^n u_k, \qquad u_1 = K^{-1} f, \qquad
    u_k = -K^{-1} \sum_q w_q \, \hat P_{k,q} G_a, \qquad k = 2, …, n

with the part P̂ₖ of the k-th term of the stress that follows from u₁ … uₖ₋₁
(`surrogate.mechanics.series.series_stress`) and the gradients G of the shape functions. The series
is that of `surrogate.mechanics.series.load_series`, in the precision of the network and on any
device.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from shared_schema.material import Materials, NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.compliance import Compliance
from surrogate.mechanics.linear_response import LinearResponse
from surrogate.mechanics.series.series_stress import SeriesStress, beyond_first


class HigherOrders(nn.Module):
    """Gradients of displacements at the quadrature points, and forces of stresses there.

    Fields are (N, d, n_nodes), displacements in m and forces in N.

    Parameters
    ----------
    geometry : Geometry
    material : NeoHookean
    gradients : Tensor, (n_cells, n_points, n_corners, d)
        Of the shape functions.
    volumes : Tensor, (n_cells, n_points)
    """

    cells: Tensor
    slopes: Tensor
    weighted: Tensor

    def __init__(
        self, geometry: Geometry, material: NeoHookean, gradients: Tensor, volumes: Tensor
    ) -> None:
        super().__init__()
        self.material = material
        cells = torch.from_numpy(geometry.cells)
        self.register_buffer("cells", cells, persistent=False)
        count, points, corners, d = gradients.shape
        slopes = gradients.permute(0, 2, 1, 3).reshape(count, corners, points * d)
        weighted = (gradients * volumes[:, :, None, None]).permute(0, 1, 3, 2)
        self.register_buffer("slopes", slopes.float(), persistent=False)
        self.register_buffer(
            "weighted", weighted.reshape(count, points * d, corners).float(), persistent=False
        )

    def gradient(self, u: Tensor) -> Tensor:
        """∂u_i/∂x_j at the quadrature points: (d, d, n_cells, N, n_points)."""
        count, corners, columns = self.slopes.shape
        samples, d, _ = u.shape
        at_corners = u.index_select(2, self.cells.flatten()).reshape(samples, d, count, corners)
        at_corners = at_corners.permute(2, 0, 1, 3).reshape(count, samples * d, corners)
        h = torch.bmm(at_corners, self.slopes).reshape(count, samples, d, columns // d, d)
        return h.permute(2, 4, 0, 1, 3)

    def forces(self, p: Tensor, nodes: int) -> Tensor:
        """Forces of stresses (d, d, n_cells, N, n_points): (N, d, n_nodes)."""
        d, _, count, samples, points = p.shape
        flat = p.permute(2, 3, 0, 4, 1).reshape(count, samples * d, points * d)
        at_corners = torch.bmm(flat, self.weighted).reshape(count, samples, d, self.cells.shape[1])
        at_corners = at_corners.permute(1, 2, 0, 3).reshape(samples, d, self.cells.numel())
        return p.new_zeros(samples, d, nodes).index_add(2, self.cells.flatten(), at_corners)


class SeriesResponse(LinearResponse):
    """Grid forces in N to the response in m to order n, and its gradients, on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
        A single Neo-Hookean material.
    gradient : bool
        Also compute the gradients.
    order : int
        Order n.

    Raises
    ------
    InputError
        If the material is another one.
    """

    series_rms: Tensor

    def __init__(
        self, geometry: Geometry, material: Materials, gradient: bool = True, order: int = 3
    ) -> None:
        if not isinstance(material, NeoHookean):
            raise InputError(
                "key 'network.skip' = 'series': expected a body of one Neo-Hookean material; "
                "'model: reduced' has series of other ones"
            )
        super().__init__(geometry, material, gradient)
        assert isinstance(self.compliance, Compliance)
        solid = self.compliance.equilibrium.solid
        self.higher = HigherOrders(geometry, material, solid.gradients, solid.volumes)
        self.order = order
        self.register_buffer("series_rms", torch.ones(()))

    @torch.no_grad()
    def scale_gradient(self, force: Tensor) -> None:
        """Measure both gradients under the forces of the training samples, (N, d, nx, ny[, nz])."""
        super().scale_gradient(force)
        self.series_rms.fill_(1.0)
        channels = slice(force.shape[1] ** 2, None)
        self.series_rms.copy_(self._gradient_rms(force, channels))

    def on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return the response, and the gradients of u₁ and of u₂ + u₃ + …, d² channels each."""
        displacement, linear = super().on_grid(nodal)
        beyond, gradient = super().on_grid(self.beyond_first(nodal))
        gradient = gradient * (self.gradient_rms / self.series_rms)
        return displacement + beyond, torch.cat([linear, gradient], dim=1)

    def first_on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return what `on_grid` does, without u₂, u₃, …: linear in the load."""
        displacement, linear = super().on_grid(nodal)
        return displacement, torch.cat([linear, torch.zeros_like(linear)], dim=1)

    def beyond_first(self, nodal: Tensor) -> Tensor:
        """u₂ + u₃ + … at the nodes in m, of u₁: (N, d, n_nodes) → same."""
        series = SeriesStress(self.higher.material, self.higher.gradient(nodal))
        beyond: Tensor = beyond_first(series, self.order, self.higher.gradient, self.balanced)
        return beyond

    def balanced(self, stress: Tensor) -> Tensor:
        """Displacements of the nodes that balance stresses: (d, d, n_cells, N, n_points)."""
        free = self.compliance.free_nodes
        forces = self.higher.forces(stress, self.nodes).index_select(2, free)
        u = -self.compliance(forces.flatten(1)).reshape(forces.shape)
        nodal: Tensor = u.new_zeros(*u.shape[:2], self.nodes).index_copy(2, free, u)
        return nodal
