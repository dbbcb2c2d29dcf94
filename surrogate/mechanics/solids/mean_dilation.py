r"""A solid whose cells change their volume as a whole: `incompressible` quadrilaterals, hexahedra.

The dilation θ is the mean of J over a cell (*F-bar*, or *mean dilatation*), and p that of ∂W/∂θ.
So the tangent of a cell with the volume V is that at fixed θ and p
(`surrogate.mechanics.solids.solid`) and

.. math::
    \frac{c ⊗ v + v ⊗ c}{V} + \frac{s}{V^2} \, v ⊗ v, \qquad
    v = \frac{∂}{∂u} \sum_q w_q J_q, \quad
    c = \sum_q w_q \frac{∂^2 W}{∂u ∂θ}, \quad s = \sum_q w_q \frac{∂^2 W}{∂θ^2}.
"""

from __future__ import annotations

import torch
from torch import Tensor

from surrogate.mechanics.solids.deformation import cofactors, determinant
from surrogate.mechanics.solids.solid import Solid, curvature, mixed


class MeanDilationSolid(Solid):
    """Energy and forces of a body of such cells, for N displacement fields at once."""

    projects = True

    def projected(self, values: Tensor) -> Tensor:
        """Mean over a cell, at its points: (n_cells, N, n_points) → same."""
        weights = self.volumes[:, None]
        mean = (weights * values).sum(-1, keepdim=True) / weights.sum(-1, keepdim=True)
        return mean.expand_as(values)

    def dilation(self, u: Tensor) -> Tensor:
        """θ of every cell: (N, n_nodes, d) in m → (n_cells, N)."""
        return self.projected(determinant(self.deformation_gradient(u)))[..., 0]

    def cell_tangents(self, u: Tensor, relaxed: bool = False) -> Tensor:
        """K of every cell, as that of `Solid`."""
        points = self.points(u)
        at_fixed = self.tangents_at(points if relaxed else self.with_pressure(points))
        volume = self.volumes.sum(1)
        of_volume = self._works(cofactors(points.f)) / volume[:, None]
        crossed = self._works(self.by_law(mixed, points))
        s = (self.volumes[:, None] * self.by_law(curvature, points)).sum(-1).T[..., None, None]
        product = crossed[..., None] * of_volume[:, :, None]
        square = of_volume[..., None] * of_volume[:, :, None]
        return at_fixed + product + product.transpose(2, 3) + s * square

    def _works(self, stress: Tensor) -> Tensor:
        """Forces of stresses in a cell: (d, d, n_cells, N, n_points) → (N, n_cells, corners d)."""
        return torch.einsum("ijcnq,cq,cqaj->ncai", stress, self.volumes, self.gradients).flatten(2)
