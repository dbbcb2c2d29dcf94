"""The response of a large body beyond the linear one, compiled, for one load at a time."""

from __future__ import annotations

import numpy as np

from surrogate.mechanics.compliance import Compliance
from surrogate.series.cell_operators import CellOperators
from surrogate.series.compiled_best_response import beyond_linear_of_one
from surrogate.series.compiled_fields import Array, forces_of_cells, slopes_in_cells


class CompiledResponse:
    """What `SeriesResponse.beyond_first` finds, cell by cell.

    Parameters
    ----------
    higher : CellOperators
        On the CPU; its precision is that of all fields.
    compliance : Compliance
    order : int
        Order n.
    """

    def __init__(self, higher: CellOperators, compliance: Compliance, order: int) -> None:
        self.material, self.compliance, self.order = higher.material, compliance, order
        self.cells, self.volumes = higher.cells.numpy(), higher.volumes.numpy()
        self.shape = compliance.equilibrium.free.shape
        count, corners, _ = higher.slopes.shape
        by_point = higher.slopes.numpy().reshape(count, corners, -1, self.shape[1])
        self.gradients = np.ascontiguousarray(by_point.swapaxes(2, 3))

    def __call__(self, first: Array) -> tuple[Array, Array]:
        """Response beyond u₁, and its last term, of u₁: (n_nodes, d) in m → same."""
        beyond, last = beyond_linear_of_one(
            self.material, self.volumes, self.order, first.ravel(), self._gradient, self._balanced
        )
        return beyond.reshape(self.shape), last.reshape(self.shape)

    def _gradient(self, u: Array) -> Array:
        """Gradients at the quadrature points: (n_dofs,) → (d, d, n_points)."""
        return slopes_in_cells(self.cells, self.gradients, u.reshape(self.shape))

    def _balanced(self, stress: Array) -> Array:
        """Displacements that balance stresses: (d, d, n_points) → (n_dofs,)."""
        of_cells = self.cells, self.gradients, self.volumes
        forces = forces_of_cells(*of_cells, stress, self.shape[0])
        u: Array = -self.compliance.respond_at_nodes(forces).ravel()
        return u
