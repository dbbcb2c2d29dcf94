r"""A solid whose cells change their volume as a whole: `incompressible` quadrilaterals, hexahedra.

The dilation θ of a cell takes the place of J at its points (*F-bar*, or *mean dilatation*; Simo,
Taylor and Pister 1985), so that the elements do not lock where the material hardly changes its
volume:

.. math::
    E(u) = \sum_q w_q W(\bar F_q), \qquad \bar F = (θ / J)^{1/d} F, \qquad
    θ = \frac{1}{V} \sum_q w_q J_q, \quad V = \sum_q w_q.

Internal forces and tangents are its derivatives, by automatic differentiation. The same equations,
in UFL, are those of `datagen.discretisation.element`; a test compares the two.

A displacement that is slightly wrong has pressures :math:`∂W/∂θ` that are very wrong, since a small
change of the volume makes a large one. The tangent without their part,
:math:`∂E/∂θ \; ∂^2 θ / ∂u^2`, is called relaxed; a step with it makes the volumes right.
"""

from __future__ import annotations

import torch
from torch import Tensor

from surrogate.mechanics.solids.hyperelastic import energy_density
from surrogate.mechanics.solids.neo_hookean import determinant
from surrogate.mechanics.solids.solid import Solid


class MeanDilationSolid(Solid):
    """Energy and forces of a body of such cells, for N displacement fields at once."""

    def energy(self, u: Tensor) -> Tensor:
        """Strain energy E(u) in J, +∞ if a cell is inverted: (N, n_nodes, d) in m → (N,)."""
        return self._cell_energies(self.at_corners(u)).sum(0)

    def internal_forces(self, u: Tensor) -> Tensor:
        """f_int = ∂E/∂u in N, no meaning if a cell is inverted: (N, n_nodes, d) in m → same."""
        with torch.inference_mode(False), torch.enable_grad():
            variable = self.at_corners(u).clone().requires_grad_()
            (forces,) = torch.autograd.grad(self._cell_energies(variable).sum(), variable)
        return self.sum_at_nodes(forces)

    def cell_tangents(self, u: Tensor, relaxed: bool = False) -> Tensor:
        """K of every cell in N/m: (N, n_nodes, d) in m → (N, n_cells, n_corners d, n_corners d).

        Rows and columns are numbered corner · d + component. A relaxed tangent lacks the part of
        the cells' pressures, as if these were unknown.
        """
        count, _, corners, d = self.gradients.shape
        with torch.inference_mode(False), torch.enable_grad():
            variable = self.at_corners(u).clone().requires_grad_()
            energy = self._cell_energies(variable, relaxed).sum()
            (forces,) = torch.autograd.grad(energy, variable, create_graph=True)
            rows = [
                torch.autograd.grad(forces[:, :, i, a].sum(), variable, retain_graph=True)[0]
                for a in range(corners)
                for i in range(d)
            ]
        k = torch.stack(rows, dim=2).transpose(-1, -2)  # (n_cells, N, rows, n_corners, d)
        return k.reshape(count, len(u), corners * d, corners * d).transpose(0, 1)

    def _cell_energies(self, at_corners: Tensor, relaxed: bool = False) -> Tensor:
        """Strain energy of every cell in J: (n_cells, N, d, n_corners) → (n_cells, N).

        A relaxed one has another gradient, and that second derivative which lacks the pressure.
        """
        f = self.gradient_of(at_corners)
        j = determinant(f)
        dilation = self._dilation_of(j)
        energies = self._energies_of(f, j, dilation)
        if relaxed:
            fixed = dilation.detach().requires_grad_()
            energy = self._energies_of(f.detach(), j.detach(), fixed).sum()
            (pull,) = torch.autograd.grad(energy, fixed)
            energies = energies - (pull * dilation).squeeze(-1)
        return energies

    def dilation(self, u: Tensor) -> Tensor:
        """θ of every cell: (N, n_nodes, d) in m → (n_cells, N)."""
        return self._dilation_of(determinant(self.deformation_gradient(u))).squeeze(-1)

    def _dilation_of(self, j: Tensor) -> Tensor:
        """Mean of J over a cell: (n_cells, N, n_points) → (n_cells, N, 1)."""
        weights = self.volumes[:, None]
        return (weights * j).sum(-1, keepdim=True) / weights.sum(-1, keepdim=True)

    def _energies_of(self, f: Tensor, j: Tensor, dilation: Tensor) -> Tensor:
        """Strain energy of every cell by F and J at its points and its θ: → (n_cells, N)."""
        inside = (j > 0).all(-1, keepdim=True)
        ratio = torch.where(inside, dilation / j, torch.ones_like(j))
        density = self.by_material(energy_density, ratio ** (1 / len(f)) * f)
        return (self.volumes[:, None] * torch.where(inside, density, torch.inf)).sum(-1)
