r"""A solid of Taylor and Hood's elements: `incompressible` triangles and tetrahedra.

Displacements are quadratic; θ and p are linear in every cell and continuous. They follow from the
displacement by solves with the mass matrix M of their functions :math:`N_a`, the projection Π of
`surrogate.mechanics.solids.solid`:

.. math::
    M θ = \sum_q w_q N_a J_q, \qquad M p = \sum_q w_q N_a \frac{∂W}{∂θ}, \qquad
    M_{ab} = \sum_q w_q N_a N_b.

They make the potential :math:`Π(u, θ, p) = \sum_q w_q [W(\bar F_q) + p_q (J_q - θ_q)]` stationary
for fixed u. The second derivative of E(u) is dense; that of Π by u, θ and p is sparse
(`surrogate.mechanics.matrices.saddle_point`). The same equations, in UFL, are those of
`datagen.discretisation.element`; a test compares the two.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu
from torch import Tensor

from shared_schema.common.bodies.quadratic.quadratic_cells import quadratic_quadrature
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.matrices.cell_matrices import sum_of_cells
from surrogate.mechanics.solids.deformation import determinant
from surrogate.mechanics.solids.solid import Points, Solid


class TaylorHoodSolid(Solid):
    """Energy and forces of a body of such cells, for N displacement fields at once.

    Parameters are those of `Solid`: coordinates and cells have all points, the nodes first.
    """

    projects = True

    def _functions(
        self, cells: NDArray[np.int64], cell_type: str
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Those of the nodes, linear in the cells."""
        points, _ = quadratic_quadrature(cell_type)
        shapes = np.concatenate([1 - points.sum(axis=1, keepdims=True), points], axis=1)
        return shapes, cells[:, : shapes.shape[1]]

    @cached_property
    def _mass(self) -> SuperLU:
        shapes, corners = self.shapes.numpy(), self.corners.numpy()
        of_cells = np.einsum("cq,qa,qb->cab", self.volumes.numpy(), shapes, shapes)
        return splu(csc_array(sum_of_cells(of_cells, corners, corners.max() + 1)))

    def projected(self, values: Tensor) -> Tensor:
        """The continuous linear function next to values: (n_cells, N, n_points) → same."""
        of_cells = (self.volumes[:, None] * values) @ self.shapes
        sums = torch.zeros(self._mass.shape[0], values.shape[1], dtype=torch.float64)
        sums.index_add_(0, self.corners.flatten(), of_cells.transpose(1, 2).flatten(0, 1))
        at_nodes = torch.from_numpy(self.solved_mass(sums.numpy()))
        return at_nodes[self.corners].transpose(1, 2) @ self.shapes.T

    def dilation(self, u: Tensor) -> Tensor:
        """θ at the middle of every cell: (N, n_nodes, d) in m → (n_cells, N)."""
        return self.projected(determinant(self.deformation_gradient(u))).mean(-1)

    def solved_mass(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """M⁻¹ of sums: (n_nodes, …) → same."""
        return np.asarray(self._mass.solve(sums))

    def composed(
        self, first: Tensor, by_dilation: Tensor, by_pressure: Tensor, square: Tensor
    ) -> Tensor:
        """∂²Π of every cell from its parts: (N, n_cells, m, m).

        Rows and columns are the displacements, corner · d + component, then the dilations of the
        corners, then their pressures.
        """
        mass = torch.einsum("cq,qa,qb->cab", self.volumes, self.shapes, self.shapes)
        mass = mass.expand_as(square)
        rows = (
            (first, by_dilation, by_pressure),
            (by_dilation.mT, square, -mass),
            (by_pressure.mT, -mass, torch.zeros_like(mass)),
        )
        return torch.cat([torch.cat(row, 3) for row in rows], 2)

    def stiffness_at_rest(self) -> Tensor:
        """K(0) of the same cells with J in place of θ, at the displacements alone."""
        d = self.gradients.shape[3]
        rest = self.deformation_gradient(self.gradients.new_zeros(1, self.nodes, d))
        laws = [law_of(material, d) for material in self.materials]
        of_displacements = self.tangents_at(Points(rest, fibres=self.fibres), laws)
        more = 2 * self.corners.shape[1]
        return torch.nn.functional.pad(of_displacements, (0, more, 0, more))
