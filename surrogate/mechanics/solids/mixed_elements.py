r"""Solids of mixed elements, which have a dilation θ and a pressure p: `incompressible` ones.

In quadrilaterals and hexahedra (*F-bar*, or *mean dilatation*), θ is the mean of J over a cell, and
p that of ∂W/∂θ. So the tangent of a cell with the volume V is that at fixed θ and p
(`surrogate.mechanics.solids.solid`) and

.. math::
    \frac{c ⊗ v + v ⊗ c}{V} + \frac{s}{V^2} \, v ⊗ v, \qquad
    v = \frac{∂}{∂u} \sum_q w_q J_q, \quad
    c = \sum_q w_q \frac{∂^2 W}{∂u ∂θ}, \quad s = \sum_q w_q \frac{∂^2 W}{∂θ^2}.

Triangles and tetrahedra are those of Taylor and Hood: displacements are quadratic; θ and p are
linear in every cell and continuous. They follow from the displacement by solves with the mass
matrix M of their functions :math:`N_a`, the projection Π of `surrogate.mechanics.solids.solid`:

.. math::
    M θ = \sum_q w_q N_a J_q, \qquad M p = \sum_q w_q N_a \frac{∂W}{∂θ}, \qquad
    M_{ab} = \sum_q w_q N_a N_b.

M⁻¹ of a small body is a matrix. M of a large one is solved with by its factor on a CPU. On other
devices, in exported files and where gradients are needed, Chebyshev's iteration does it by products
alone: with the diagonal D of M, the eigenvalues
of :math:`D^{-1} M` lie between those of a cell, 1/2 and :math:`1 + d / 2` (A. J. Wathen, *Realistic
eigenvalue bounds for the Galerkin mass matrix*, IMA Journal of Numerical Analysis 7, 1987), so that
an error falls to 0.38 of it or less.

They make the potential :math:`Π(u, θ, p) = \sum_q w_q [W(\bar F_q) + p_q (J_q - θ_q)]` stationary
for fixed u. The second derivative of E(u) is dense; that of Π by u, θ and p is sparse
(`surrogate.mechanics.matrices.saddle_point`). The same equations, in UFL, are those of
`datagen.discretisation.element`; a test compares the two.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import SuperLU, splu
from torch import Tensor

from shared_schema.common.bodies.reference_cells import quadratic_quadrature
from surrogate.mechanics.energy.law import law_of
from surrogate.mechanics.matrices.factors import sum_of_cells
from surrogate.mechanics.matrices.sparse_products import SparseProduct
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
        half = (by_dilation + square / 2 * of_volume) @ of_volume.mT
        return first + half + half.mT


DENSE = 1000  # functions up to which M⁻¹ is a matrix
ITERATIONS = 24  # 0.38²⁴ is 1e-10


class TaylorHoodSolid(Solid):
    """Energy and forces of a body of such cells, for N displacement fields at once.

    Parameters are those of `Solid`: coordinates and cells have all points, the nodes first.
    """

    projects = True
    diagonal: Tensor
    inverse: Tensor

    def __init__(self, *given: Any, **others: Any) -> None:
        super().__init__(*given, **others)
        corners = self.corners.numpy()
        mass = sum_of_cells(self.mass_of_cells.numpy(), corners, corners.max() + 1)
        diagonal = torch.from_numpy(mass.diagonal())[:, None]
        self.register_buffer("diagonal", diagonal, persistent=False)
        shape, places = (len(diagonal), corners.size), np.arange(corners.size)
        incidence = csr_array((np.ones(corners.size), (corners.ravel(), places)), shape)
        self.sums_of_functions = SparseProduct(incidence, self.volumes.dtype)
        small = len(diagonal) <= DENSE
        inverse = torch.from_numpy(np.linalg.inv(mass.toarray())) if small else torch.empty(0)
        self.register_buffer("inverse", inverse, persistent=False)
        self.mass, self._matrix = SparseProduct(mass, self.volumes.dtype), csc_array(mass)

    def _functions(
        self, cells: NDArray[np.int64], cell_type: str
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Those of the nodes, linear in the cells."""
        points, _ = quadratic_quadrature(cell_type)
        shapes = np.concatenate([1 - points.sum(axis=1, keepdims=True), points], axis=1)
        return shapes, cells[:, : shapes.shape[1]]

    @property
    def mass_of_cells(self) -> Tensor:
        """M of every cell: (n_cells, n_functions, n_functions)."""
        return torch.einsum("cq,qa,qb->cab", self.volumes, self.shapes, self.shapes)

    @cached_property
    def _mass(self) -> SuperLU:
        return splu(self._matrix)

    def projected(self, values: Tensor) -> Tensor:
        """The continuous linear function next to values: (n_cells, N, n_points) → same."""
        of_cells = (self.volumes[:, None] * values) @ self.shapes
        sums: Tensor = self.sums_of_functions(of_cells.transpose(1, 2).flatten(0, 1))
        if len(self.inverse):
            return self._at_points(self.inverse @ sums)
        by_factor = values.device.type == "cpu" and not torch.compiler.is_compiling()
        if by_factor and not (torch.is_grad_enabled() and values.requires_grad):
            at_nodes = torch.from_numpy(self.solved_mass(sums.detach().numpy()))
        else:
            at_nodes = self._iterated(sums)
        return self._at_points(at_nodes)

    def _at_points(self, at_nodes: Tensor) -> Tensor:
        """Values at the points by those of the nodes: (n_nodes, N) → (n_cells, N, n_points)."""
        rows = at_nodes.index_select(0, self.corners.flatten())
        at_corners = rows.reshape(*self.corners.shape, -1).transpose(1, 2)
        return torch.nn.functional.linear(at_corners, self.shapes)

    def _iterated(self, right: Tensor) -> Tensor:
        """M⁻¹ by Chebyshev's iteration (Saad 2003, Algorithm 12.1): (n_nodes, N) → same."""
        largest = 1 + self.gradients.shape[3] / 2
        middle, half = (largest + 0.5) / 2, (largest - 0.5) / 2
        ratio = half / middle
        step = right / self.diagonal / middle
        found = step
        for _ in range(ITERATIONS):
            rest = right - self.mass(found)
            after = 1 / (2 * middle / half - ratio)
            step = after * ratio * step + 2 * after / half * rest / self.diagonal
            found, ratio = found + step, after
        return found

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
        mass = self.mass_of_cells.expand_as(square)
        rows = (
            (first, by_dilation, by_pressure),
            (by_dilation.mT, square, -mass),
            (by_pressure.mT, -mass, torch.zeros_like(mass)),
        )
        return torch.cat([torch.cat(row, 3) for row in rows], 2)

    def stiffness_at_rest(self) -> Tensor:
        """K(0) of the same cells with J in place of θ, at the displacements alone."""
        alone = copy(self)
        alone.projects = False
        alone.__dict__["laws"] = [law_of(each, self.gradients.shape[3]) for each in self.materials]
        alone.__dict__.pop("compiled", None)
        more = 2 * self.corners.shape[1]
        return torch.nn.functional.pad(Solid.stiffness_at_rest(alone), (0, more, 0, more))
