r"""A solid of finite elements: strain energy, internal forces, tangent.

With the displacements u at the nodes, the shape functions' gradients :math:`G_a = ∇N_a` and the
quadrature volumes :math:`w_q`,

.. math::
    F = I + \sum_a u_a ⊗ G_a, \qquad E(u) = \sum_q w_q W(F_q), \qquad
    f_{int,a} = \frac{∂E}{∂u_a} = \sum_q w_q P_q G_a.

The tangent of a cell is :math:`K_{aibk} = \sum_q w_q G_{aj} \mathbb{A}_{ijkl} G_{bl}` with the
moduli of `surrogate.mechanics.solids.hyperelastic`. That of a Neo-Hookean cell has a closed form
with the gradients :math:`g_a = F^{-T} G_a` on the deformed body
(`surrogate.mechanics.solids.neo_hookean`):

.. math::
    K_{ab} = \frac{∂f_{int,a}}{∂u_b} = \sum_q w_q \left[ μ (G_a · G_b) I
    + (μ - J U') \, g_b ⊗ g_a + (J U' + J^2 U'') \, g_a ⊗ g_b \right].

The same equations, in UFL, are those of `datagen`; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from shared_schema.materials import Materials, NeoHookean, ShippedMaterial, as_tuple
from surrogate.mechanics.solids.elements import cell_gradients
from surrogate.mechanics.solids.hyperelastic import energy_density, moduli, stress
from surrogate.mechanics.solids.neo_hookean import determinant, inverse_transpose, tangent_moduli


class Solid(nn.Module):
    """Energy and forces of a body, for N displacement fields at once.

    Its tensors are in double precision on the CPU; ``.to(device, dtype)`` moves them.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        Meshio's name of the cells.
    material : ShippedMaterial, or tuple of some
    parts : array of int, (n_cells,), optional
        Position of each cell's material in the tuple.

    Attributes
    ----------
    nodes : int
        Number of nodes.
    """

    cells: Tensor
    gradients: Tensor
    volumes: Tensor
    constant: Tensor
    _order: Tensor

    def __init__(
        self,
        coordinates: NDArray[np.float64],
        cells: NDArray[np.int64],
        cell_type: str,
        material: Materials,
        parts: NDArray[np.int64] | None = None,
    ) -> None:
        super().__init__()
        gradients, volumes = cell_gradients(coordinates, cells, cell_type)
        constant = np.empty(0)
        if isinstance(material, NeoHookean):
            metric = np.einsum("cq,cqaj,cqbj->cab", volumes, gradients, gradients)
            constant = material.lame_mu * metric
        self.nodes = len(coordinates)
        self.materials = as_tuple(material)
        self.neo_hookean = material if isinstance(material, NeoHookean) else None
        self._members = []
        if len(self.materials) > 1:
            if parts is None or not np.all((parts >= 0) & (parts < len(self.materials))):
                raise ValueError("a cell is of none of the materials")
            self._members = [np.flatnonzero(parts == i) for i in range(len(self.materials))]
            order = torch.from_numpy(np.argsort(np.concatenate(self._members)))
            self.register_buffer("_order", order, persistent=False)
        self.register_buffer("cells", torch.tensor(cells), persistent=False)
        self.register_buffer("gradients", torch.from_numpy(gradients), persistent=False)
        self.register_buffer("volumes", torch.from_numpy(volumes), persistent=False)
        self.register_buffer("constant", torch.from_numpy(constant), persistent=False)

    def deformation_gradient(self, u: Tensor) -> Tensor:
        """F at the quadrature points: (N, n_nodes, d) in m → (d, d, n_cells, N, n_points)."""
        return self.gradient_of(self.at_corners(u))

    def at_corners(self, u: Tensor) -> Tensor:
        """Displacements of the cells' corners: (N, n_nodes, d) → (n_cells, N, d, n_corners)."""
        return u[:, self.cells].permute(1, 0, 3, 2)

    def gradient_of(self, at_corners: Tensor) -> Tensor:
        """F at the quadrature points: (n_cells, N, d, n_corners) → (d, d, n_cells, N, n_points)."""
        count, points, corners, d = self.gradients.shape
        samples = at_corners.shape[1]
        slopes = self.gradients.transpose(1, 2).reshape(count, corners, points * d)
        h = torch.bmm(at_corners.reshape(count, samples * d, corners), slopes)
        h = h.reshape(count, samples, d, points, d)
        identity = torch.eye(d, dtype=h.dtype, device=h.device)
        return h.permute(2, 4, 0, 1, 3).contiguous() + identity[:, :, None, None, None]

    def sum_at_nodes(self, forces: Tensor) -> Tensor:
        """Sum what acts at the corners: (n_cells, N, d, n_corners) → (N, n_nodes, d)."""
        at_nodes = forces.permute(1, 0, 3, 2).flatten(1, 2)
        total = forces.new_zeros(forces.shape[1], self.nodes, forces.shape[2])
        return total.index_add(1, self.cells.flatten(), at_nodes)

    def by_material(
        self, function: Callable[[Tensor, ShippedMaterial], Tensor], f: Tensor
    ) -> Tensor:
        """Apply a function of F and a material to F of all cells, the axis before the last two."""
        if len(self.materials) == 1:
            return function(f, self.materials[0])
        results = [
            function(f[:, :, members], material)
            for members, material in zip(self._members, self.materials, strict=True)
        ]
        return torch.cat(results, dim=-3).index_select(-3, self._order)

    def material_of_cells(self) -> Tensor:
        """Position of each cell's material, (n_cells,)."""
        numbers = torch.zeros(len(self.cells), dtype=torch.int64)
        for number, members in enumerate(self._members):
            numbers[members] = number
        return numbers

    def inverted(self, u: Tensor) -> Tensor:
        """Number of cells with J ≤ 0 (or no number) at a point: (N, n_nodes, d) in m → (N,)."""
        j = determinant(self.deformation_gradient(u))
        return (~((j > 0) & (j < torch.inf))).any(dim=2).sum(dim=0)  # true for NaN as well

    def energy(self, u: Tensor) -> Tensor:
        """Strain energy E(u) in J, +∞ if a cell is inverted: (N, n_nodes, d) in m → (N,)."""
        density = self.by_material(energy_density, self.deformation_gradient(u))
        return (self.volumes[:, None] * density).sum((0, 2))

    def first_piola(self, u: Tensor) -> Tensor:
        """P in Pa at the quadrature points: (N, n_nodes, d) → (d, d, n_cells, N, n_points)."""
        return self.by_material(stress, self.deformation_gradient(u))

    def internal_forces(self, u: Tensor) -> Tensor:
        """f_int = ∂E/∂u in N, no meaning if a cell is inverted: (N, n_nodes, d) in m → same."""
        count, points, corners, d = self.gradients.shape
        p = self.volumes[:, None] * self.first_piola(u)
        p = p.permute(2, 3, 0, 4, 1).reshape(count, len(u) * d, points * d)
        slopes = self.gradients.transpose(2, 3).reshape(count, points * d, corners)
        return self.sum_at_nodes(torch.bmm(p, slopes).reshape(count, len(u), d, corners))

    def stiffness_at_rest(self) -> Tensor:
        """Positive definite stiffness K(0) of every cell, of the shape of `cell_tangents`."""
        return self.cell_tangents(self.gradients.new_zeros(1, self.nodes, self.gradients.shape[3]))

    def cell_tangents(self, u: Tensor) -> Tensor:
        """K of every cell in N/m: (N, n_nodes, d) in m → (N, n_cells, n_corners d, n_corners d).

        Rows and columns are numbered corner · d + component.
        """
        count, points, corners, d = self.gradients.shape
        f = self.deformation_gradient(u)
        if self.neo_hookean is None:
            a = self.by_material(moduli, f) * self.volumes[:, None]
            k = torch.einsum("cqaj,ijklcnq,cqbl->ncaibk", self.gradients, a, self.gradients)
            return k.reshape(len(u), count, corners * d, corners * d)
        j = determinant(f)
        inverse = inverse_transpose(f, j).permute(2, 4, 1, 3, 0).reshape(count * points, d, -1)
        g = torch.bmm(self.gradients.reshape(-1, corners, d), inverse)
        g = g.reshape(count, points, corners, len(u), d).permute(3, 0, 1, 2, 4)
        g = g.reshape(len(u) * count, points, corners * d)
        crossed, squared = tangent_moduli(j, self.neo_hookean)
        crossed = (self.volumes[:, None] * crossed).transpose(0, 1).reshape(-1, points, 1)
        squared = (self.volumes[:, None] * squared).transpose(0, 1).reshape(-1, points, 1)
        k = torch.bmm((squared * g).transpose(1, 2), g)
        k = k.reshape(-1, corners, d, corners, d)
        swapped = torch.bmm((crossed * g).transpose(1, 2), g).reshape(k.shape)
        k += swapped.permute(0, 3, 2, 1, 4)
        k = k.reshape(len(u), count, corners, d, corners, d)
        k.diagonal(dim1=3, dim2=5).add_(self.constant[..., None])
        return k.reshape(len(u), count, corners * d, corners * d)
