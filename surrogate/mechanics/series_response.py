r"""The response of the body to forces on the grid, to third order in the load.

.. math::
    U = A (u_1 + u_2 + u_3), \qquad u_1 = K^{-1} f, \qquad
    u_k = -K^{-1} \sum_q w_q \, P^{(k)}_q G_a, \qquad k = 2, 3

with the series of `surrogate.mechanics.load_series`. On the path :math:`F = I + t A + t^2 B`, with
the gradients A of u₁ and B of u₂, the stress of the Neo-Hookean solid has the terms

.. math::
    X^{(1)} = A, \quad X^{(2)} = B - A^2, \quad X^{(3)} = A^3 - A B - B A, \qquad
    F^{-1} = I - \sum_k t^k X^{(k)} + O(t^4),

.. math::
    \ell_1 = \mathrm{tr} A, \quad \ell_2 = \mathrm{tr} B - \tfrac{1}{2} \mathrm{tr} A^2, \quad
    \ell_3 = \tfrac{1}{3} \mathrm{tr} A^3 - \mathrm{tr} (A B), \qquad \ln J = \sum_k t^k \ell_k,

.. math::
    P^{(2)} = -μ (A^2)^T + p_2 I - p_1 A^T \quad (B = 0), \qquad
    P^{(3)} = μ X^{(3) T} + p_3 I - p_2 A^T - p_1 X^{(2) T}

where :math:`J U' = λ (\ln J + g_2 \ln^2 J + g_3 \ln^3 J + …) = \sum_k t^k p_k`.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from shared_schema.material import Materials, NeoHookean
from surrogate.data.geometry import Geometry
from surrogate.mechanics.linear_response import LinearResponse

# J U' = λ/2 (J² - 1) and λ J (J - 1), in powers of ln J
VOLUMETRIC = {"paper": (1.0, 2 / 3), "quadratic": (3 / 2, 7 / 6)}


class HigherOrders(nn.Module):
    """Forces at the nodes that make the terms of second and third order.

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
        self.lam, self.mu = material.lame_lambda, material.lame_mu
        self.g2, self.g3 = VOLUMETRIC[material.volumetric]
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
        """∂u_i/∂x_j at the quadrature points: (n_cells, N, n_points, d, d)."""
        count, corners, columns = self.slopes.shape
        samples, d, _ = u.shape
        at_corners = u.index_select(2, self.cells.flatten()).reshape(samples, d, count, corners)
        at_corners = at_corners.permute(2, 0, 1, 3).reshape(count, samples * d, corners)
        h = torch.bmm(at_corners, self.slopes).reshape(count, samples, d, columns // d, d)
        return h.transpose(2, 3)

    def forces(self, p: Tensor, nodes: int) -> Tensor:
        """Forces of stresses (n_cells, N, n_points, d, d): (N, d, n_nodes)."""
        count, samples, points, d, _ = p.shape
        flat = p.transpose(2, 3).reshape(count, samples * d, points * d)
        at_corners = torch.bmm(flat, self.weighted).reshape(count, samples, d, -1)
        at_corners = at_corners.permute(1, 2, 0, 3).reshape(samples, d, -1)
        return p.new_zeros(samples, d, nodes).index_add(2, self.cells.flatten(), at_corners)

    def second(self, a: Tensor) -> Tensor:
        """P⁽²⁾ of a gradient A."""
        square, trace = a @ a, _trace(a)
        pressure = self.lam * (self.g2 * trace.square() - _trace(square) / 2)
        return pressure * _identity(a) - (self.mu * square + self.lam * trace * a).transpose(-1, -2)

    def third(self, a: Tensor, b: Tensor) -> Tensor:
        """P⁽³⁾ of gradients A and B."""
        square, product = a @ a, a @ b
        cube = square @ a
        l1, l2 = _trace(a), _trace(b) - _trace(square) / 2
        l3 = _trace(cube) / 3 - _trace(product)
        p2 = self.lam * (l2 + self.g2 * l1.square())
        p3 = self.lam * (l3 + 2 * self.g2 * l1 * l2 + self.g3 * l1**3)
        inverse = self.mu * (cube - product - b @ a) - p2 * a - self.lam * l1 * (b - square)
        return p3 * _identity(a) + inverse.transpose(-1, -2)


class SeriesResponse(LinearResponse):
    """Grid forces in N to the response in m to third order, and its gradients, on the grid.

    Parameters
    ----------
    geometry : Geometry
    material : ShippedMaterial, or tuple of some
        A single Neo-Hookean material.
    gradient : bool
        Also compute the gradients.

    Raises
    ------
    InputError
        If the material is another one.
    """

    series_rms: Tensor

    def __init__(self, geometry: Geometry, material: Materials, gradient: bool = True) -> None:
        if not isinstance(material, NeoHookean):
            raise InputError(
                "key 'network.skip' = 'series': expected a body of one Neo-Hookean material; "
                "'model: reduced' has series of other ones"
            )
        super().__init__(geometry, material, gradient)
        solid = self.compliance.equilibrium.solid
        self.higher = HigherOrders(geometry, material, solid.gradients, solid.volumes)
        self.register_buffer("series_rms", torch.ones(()))

    @torch.no_grad()
    def scale_gradient(self, force: Tensor) -> None:
        """Measure both gradients under the forces of the training samples, (N, d, nx, ny[, nz])."""
        super().scale_gradient(force)
        self.series_rms.fill_(1.0)
        channels = slice(force.shape[1] ** 2, None)
        self.series_rms.copy_(self._gradient_rms(force, channels))

    def on_grid(self, nodal: Tensor) -> tuple[Tensor, Tensor]:
        """Return the response, and the gradients of u₁ and of u₂ + u₃: both have d² channels."""
        _, linear = super().on_grid(nodal)
        a = self.higher.gradient(nodal)
        second = self._responded(self.higher.second(a))
        third = self._responded(self.higher.third(a, self.higher.gradient(second)))
        beyond = second + third
        displacement, gradient = super().on_grid(beyond)
        total = super().on_grid(nodal)[0] + displacement
        gradient = gradient * (self.gradient_rms / self.series_rms)
        return total, torch.cat([linear, gradient], dim=1)

    def _responded(self, stress: Tensor) -> Tensor:
        """Displacements that balance a stress at the nodes."""
        free = self.compliance.free_nodes
        forces = self.higher.forces(stress, self.nodes).index_select(2, free)
        u = -self.compliance(forces.flatten(1)).reshape(forces.shape)
        return u.new_zeros(*u.shape[:2], self.nodes).index_copy(2, free, u)


def _trace(a: Tensor) -> Tensor:
    """Trace of matrices, (…, 1, 1)."""
    trace: Tensor = a.diagonal(dim1=-2, dim2=-1).sum(-1)
    return trace[..., None, None]


def _identity(a: Tensor) -> Tensor:
    return torch.eye(a.shape[-1], dtype=a.dtype, device=a.device)
