r"""A solid of Taylor and Hood's elements: `incompressible` triangles and tetrahedra.

Displacements are quadratic. In the energy, a dilation θ that is linear in every cell and continuous
takes the place of J, so that the elements do not lock where the material hardly changes its volume:

.. math::
    Π(u, θ, p) = \sum_q w_q \left[ W(\bar F_q) + p_q (J_q - θ_q) \right], \qquad
    \bar F = (θ / J)^{1/d} F

with a pressure p of the same functions :math:`N_a` as θ (Simo, Taylor and Pister 1985). Both follow
from the displacement, by solves with the mass matrix M of these functions:

.. math::
    M θ = \sum_q w_q N_a J_q, \qquad M p = \sum_q w_q N_a \frac{∂W}{∂θ}, \qquad
    M_{ab} = \sum_q w_q N_a N_b

So the energy E(u) = Π(u, θ(u), ·) is one of u alone, and its derivative is that of Π for fixed θ
and p. The second derivative of E is dense; that of Π by u, θ and p is sparse
(`surrogate.mechanics.matrices.saddle_point`). The same equations, in UFL, are those of
`datagen.discretisation.element`; a test compares the two.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu
from torch import Tensor

from shared_schema.common.bodies.quadratic.quadratic_cells import quadratic_quadrature
from shared_schema.materials import Materials
from surrogate.mechanics.matrices.cell_matrices import sum_of_cells
from surrogate.mechanics.solids.hyperelastic import energy_density
from surrogate.mechanics.solids.neo_hookean import determinant
from surrogate.mechanics.solids.solid import Solid


class TaylorHoodSolid(Solid):
    """Energy and forces of a body of such cells, for N displacement fields at once.

    Parameters are those of `Solid`: coordinates and cells have all points, the nodes first.
    """

    def __init__(
        self,
        coordinates: NDArray[np.float64],
        cells: NDArray[np.int64],
        cell_type: str,
        material: Materials,
        parts: NDArray[np.int64] | None = None,
    ) -> None:
        super().__init__(coordinates, cells, cell_type, material, parts)
        points, _ = quadratic_quadrature(cell_type)
        shapes = np.concatenate([1 - points.sum(axis=1, keepdims=True), points], axis=1)
        corners = cells[:, : shapes.shape[1]]
        self.shapes, self.corners = torch.from_numpy(shapes), torch.tensor(corners)
        of_cells = np.einsum("cq,qa,qb->cab", self.volumes.numpy(), shapes, shapes)
        self._mass = splu(csc_array(sum_of_cells(of_cells, corners, corners.max() + 1)))

    def dilation(self, u: Tensor) -> Tensor:
        """θ at the middle of every cell: (N, n_nodes, d) in m → (n_cells, N)."""
        return self._projected(determinant(self.deformation_gradient(u))).mean(-1)

    def inverted(self, u: Tensor) -> Tensor:
        """Number of cells with J ≤ 0 or θ ≤ 0 (or no number) at a point: (N, n_nodes, d) → (N,)."""
        j = determinant(self.deformation_gradient(u))
        return (~_inside(j, self._projected(j))).any(dim=2).sum(dim=0)

    def energy(self, u: Tensor) -> Tensor:
        """Strain energy E(u) in J, +∞ if a cell is inverted: (N, n_nodes, d) in m → (N,)."""
        f = self.deformation_gradient(u)
        density = self._density(f, self._projected(determinant(f)))
        return (self.volumes[:, None] * density).sum((0, 2))

    def first_piola(self, u: Tensor) -> Tensor:
        """∂Π/∂F at the quadrature points: (N, n_nodes, d) in m → (d, d, n_cells, N, n_points)."""
        f, dilation, pressure = self._state(u)
        with torch.inference_mode(False), torch.enable_grad():
            variable = f.clone().requires_grad_()
            density = self._density(variable, dilation) + pressure * determinant(variable)
            (p,) = torch.autograd.grad(density.sum(), variable)
        return p

    def cell_tangents(self, u: Tensor, relaxed: bool = False) -> Tensor:
        """∂²Π of every cell: (N, n_nodes, d) in m → (N, n_cells, m, m).

        Rows and columns are the displacements, corner · d + component, then the dilations of the
        corners, then their pressures. A relaxed tangent is that without pressures.
        """
        f, dilation, pressure = self._state(u)
        d = len(f)
        with torch.inference_mode(False), torch.enable_grad():
            kept = torch.zeros_like(pressure) if relaxed else pressure
            z = torch.cat([f.flatten(0, 1), dilation[None], kept[None]]).requires_grad_()
            gradient = z[: d * d].reshape(f.shape)
            constraint = determinant(gradient) - z[-2]
            density = self._density(gradient, z[-2]) + z[-1] * constraint
            (first,) = torch.autograd.grad(density.sum(), z, create_graph=True)
            rows = [torch.autograd.grad(row.sum(), z, retain_graph=True)[0] for row in first]
        second = torch.stack(rows) * self.volumes[:, None]
        slopes = self._slopes_of_unknowns
        return torch.einsum("cqrm,rscnq,cqsl->ncml", slopes, second, slopes)

    def stiffness_at_rest(self) -> Tensor:
        """K(0) of the same cells with J in place of θ, at the displacements alone."""
        rest = self.gradients.new_zeros(1, self.nodes, self.gradients.shape[3])
        of_displacements = super().cell_tangents(rest)
        more = 2 * self.corners.shape[1]
        return torch.nn.functional.pad(of_displacements, (0, more, 0, more))

    @property
    def _slopes_of_unknowns(self) -> Tensor:
        """Derivatives of F, θ and p at the points by the unknowns of every cell.

        (n_cells, n_points, d² + 2, m).
        """
        count, points, corners, d = self.gradients.shape
        pressures = self.corners.shape[1]
        slopes = torch.zeros(
            count, points, d * d + 2, corners * d + 2 * pressures, dtype=torch.float64
        )
        for i in range(d):
            slopes[:, :, i * d : (i + 1) * d, i : corners * d : d] = self.gradients.transpose(2, 3)
        slopes[:, :, -2, corners * d : -pressures] = self.shapes
        slopes[:, :, -1, -pressures:] = self.shapes
        return slopes

    def _state(self, u: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """F, θ and p at the quadrature points: (N, n_nodes, d) in m → (…, n_cells, N, n_points)."""
        f = self.deformation_gradient(u)
        dilation = self._projected(determinant(f))
        with torch.inference_mode(False), torch.enable_grad():
            variable = dilation.clone().requires_grad_()
            density = self._density(f, variable).sum()
            (slope,) = torch.autograd.grad(density, variable)
        return f, dilation, self._projected(slope)

    def _projected(self, values: Tensor) -> Tensor:
        """The continuous linear function next to values at the points: (n_cells, N, n_points)."""
        of_cells = (self.volumes[:, None] * values) @ self.shapes
        sums = torch.zeros(self._mass.shape[0], values.shape[1], dtype=torch.float64)
        sums.index_add_(0, self.corners.flatten(), of_cells.transpose(1, 2).flatten(0, 1))
        at_nodes = torch.from_numpy(self._mass.solve(sums.numpy()))
        return at_nodes[self.corners].transpose(1, 2) @ self.shapes.T

    def _density(self, f: Tensor, dilation: Tensor) -> Tensor:
        """W(F̄) in J/m³ at the points, +∞ where J or θ is not positive: → (n_cells, N, n_points)."""
        j = determinant(f)
        inside = _inside(j, dilation)
        ratio = torch.where(inside, dilation / j, torch.ones_like(j))
        density = self.by_material(energy_density, ratio ** (1 / len(f)) * f)
        return torch.where(inside, density, torch.inf)


def _inside(j: Tensor, dilation: Tensor) -> Tensor:
    return (j > 0) & (j < torch.inf) & (dilation > 0) & (dilation < torch.inf)
