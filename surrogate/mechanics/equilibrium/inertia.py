r"""What a time step adds to an equilibrium: springs to where the body would coast, and viscosity.

A step from u, v, a to u' (`shared_schema.motion.scheme`) is the equilibrium

.. math:: f_{int}(u') - f + A (u' - ũ) + f_v(u', v_d(u')) = 0, \qquad
          A = k M, \quad A ũ = A u^* - M g - r R,

with the mass M, the position u* that the body would coast to, and the last forces out of balance R.
Forces of the stresses :math:`S_v = 2 μ b \dot E`, with the shear modulus μ at rest, are

.. math:: f_v = \sum_q w_q F S_v ∇N, \qquad \dot E = \operatorname{sym}(F^T ∇v_d).

The tangent takes F with the velocity as a change of the displacement, and leaves out what S_v
itself adds, which is small beside A; A makes it positive definite for a small step, whatever the
body does. Without viscosity there is a potential,

.. math:: Π_A(u) = \tfrac12 u^T A u - u^T A ũ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor

from shared_schema.common.bodies.reference_cells import CORNERS, LINEAR
from shared_schema.motion import Begun, Scheme, mass_blocks
from surrogate.mechanics.matrices.factors import sum_of_cells
from surrogate.mechanics.solids.mixed_elements import TaylorHoodSolid

if TYPE_CHECKING:
    from surrogate.mechanics.body.geometry import Geometry
    from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Masses:
    """Masses and viscosity of a body in steps of one length.

    Attributes
    ----------
    solid : Solid
    scheme : Scheme
    blocks : array, (n_cells, n_corners, n_corners)
        M of every cell and one component in kg.
    matrix : csr_array, (n_points, n_points)
        M of one component.
    viscosity : array, (n_cells,), or None
        2 μ b in Pa s.
    """

    solid: Solid
    scheme: Scheme
    blocks: Array
    matrix: csr_array
    viscosity: Array | None

    @classmethod
    def of(
        cls,
        solid: Solid,
        geometry: Geometry,
        scheme: Scheme,
        density: Array,
        stiffness_damping: float = 0.0,
        lumped: bool = False,
    ) -> Masses:
        """Of the elements of a body, with the density of every cell in kg/m³, and b in s."""
        cells, kind = geometry.cells, geometry.cell_type
        corners = len(CORNERS[LINEAR.get(kind, kind)])
        blocks = mass_blocks(kind, geometry.coordinates[cells[:, :corners]], density, lumped)
        matrix = sum_of_cells(blocks, cells, len(geometry.coordinates))
        viscosity = 2 * stiffness_damping * solid.moduli_of_cells().numpy()
        return cls(solid, scheme, blocks, matrix, viscosity if stiffness_damping else None)

    def in_steps(self, scheme: Scheme) -> Masses:
        """The same in steps of another length."""
        return replace(self, scheme=scheme)

    @cached_property
    def diagonal(self) -> Array:
        """Mass of every point in kg, (n_points,): sums of the rows."""
        return np.asarray(self.matrix.sum(axis=1))

    def tangents(self, u: Array | None = None) -> Tensor:
        """A and the viscous tangent of every cell in N/m, at u (n_points, d) in m or at rest."""
        solid, (count, corners, _) = self.solid, self.blocks.shape
        d, beside = solid.gradients.shape[3], 0
        if isinstance(solid, TaylorHoodSolid):
            beside = 2 * solid.corners.shape[1]
        springs = np.einsum("cab,ij->caibj", self.scheme.spring * self.blocks, np.eye(d))
        found = torch.from_numpy(springs.reshape(1, count, corners * d, corners * d))
        if self.viscosity is not None:
            found = found + self._viscous(u)
        return torch.nn.functional.pad(found, (0, beside, 0, beside))

    def _viscous(self, u: Array | None) -> Tensor:
        """S ∂f_v/∂v of every cell, with the slope S of the velocity."""
        solid, slope = self.solid, self.scheme.damping_slope
        assert self.viscosity is not None
        g = solid.gradients  # (c, q, a, j)
        shape = torch.zeros(1, solid.nodes, g.shape[3], dtype=g.dtype)
        at = shape if u is None else torch.from_numpy(u[None])
        f = solid.deformation_gradient(at)[:, :, :, 0].permute(2, 3, 0, 1)  # (c, q, i, j)
        strain = torch.einsum("cqij,cqak->cqaijk", f, g)
        strain = (strain + strain.transpose(-1, -2)) / 2
        weights = slope * torch.from_numpy(self.viscosity)[:, None] * solid.volumes
        count, points, corners, d = g.shape
        rows = (weights.sqrt()[:, :, None, None, None, None] * strain).reshape(
            count, points, corners * d, d * d
        )
        rows = rows.transpose(1, 2).reshape(count, corners * d, points * d * d)
        return (rows @ rows.mT)[None]

    def viscous_forces(self, u: Array, v: Array) -> Array:
        """f_v in N of a displacement in m and a velocity in m/s, (n_points, d) each."""
        if self.viscosity is None:
            return np.zeros(u.shape)
        return self.solid.compiled.viscous_forces(self.viscosity, u, v)


@dataclass(frozen=True)
class Inertia:
    """The inertia of one step.

    Attributes
    ----------
    masses : Masses
    begun : Begun
        u* and v*, (n_points, d) in m and m/s, and g.
    pull : array, (n_points, d)
        A ũ in N.
    """

    masses: Masses
    begun: Begun
    pull: Array

    @classmethod
    def of(cls, masses: Masses, u: Array, v: Array, a: Array, left: Array) -> Inertia:
        """Begin a step from u in m, v in m/s, a in m/s² and R in N, all (n_points, d)."""
        scheme = masses.scheme
        begun = scheme.begin(u, v, a)
        return cls(masses, begun, scheme.pull(masses.matrix, begun, left))

    def forces(self, u: Array) -> Array:
        """−A (u − ũ) − f_v in N, (n_points, d)."""
        masses = self.masses
        found: Array = self.pull - masses.scheme.spring * (masses.matrix @ u)
        if masses.viscosity is None:
            return found
        return found - masses.viscous_forces(u, masses.scheme.damping_velocity(self.begun, u))

    def potential(self, u: Array) -> float:
        """Π_A in J of one displacement, (n_points, d)."""
        spring = self.masses.scheme.spring * (self.masses.matrix @ u)
        return float(np.vdot(u, spring / 2 - self.pull))
