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

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.solids.deformation import determinant
from surrogate.mechanics.solids.solid import Solid


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

    def _functions(
        self, cells: NDArray[np.int64], cell_type: str
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """One of every cell, 1 at its points."""
        return np.ones((self.volumes.shape[1], 1)), np.arange(len(cells))[:, None]

    def solved_mass(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Divide by the volumes of the cells."""
        return sums / self.volumes.sum(1).numpy()

    def composed(
        self, first: Tensor, by_dilation: Tensor, by_pressure: Tensor, square: Tensor
    ) -> Tensor:
        """Tangent of cells from its parts, as that of `Solid`."""
        of_volume = by_pressure / self.volumes.sum(1)[:, None, None]
        product = by_dilation @ of_volume.mT
        return first + product + product.mT + square * of_volume @ of_volume.mT
