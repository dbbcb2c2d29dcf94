"""A body as directions see it: out-of-balance forces of single states, and the inverse of tangents.

What does not depend on the load is made once. Forces that are a sum over quadrature points are
summed in compiled loops (`surrogate.descent.cell_stress`), in a third of the time or less; others
are those of the solid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.descent.carried_compliance import CarriedCompliance
from surrogate.descent.cell_fields import CellFields, jacobian
from surrogate.descent.cell_stress import CellStress
from surrogate.descent.soft_modes import Softening, SoftModes
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.matrices.tangent_iterations import iterates
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """A displacement without inverted cells.

    Attributes
    ----------
    u : array, (n_points, d)
        In m.
    r : array, (n_points, d)
        Out-of-balance forces r(u) in N; zero where it is held.
    f, piola : array, (d, d, n), or None
        F and the first Piola–Kirchhoff stress in Pa at the quadrature points; None if the forces of
        a cell are no sum over them.
    """

    u: Array
    r: Array
    f: Array | None = None
    piola: Array | None = None


@dataclass(frozen=True)
class DrivenBody:
    """A body whose predictions are driven towards the equilibrium.

    Attributes
    ----------
    equilibrium : Equilibrium
        Also under the pressures of a load. With `compliance` it `iterates`, if factors take longer.
    compliance : CarriedCompliance
    fields : CellFields or None
        None if the forces of a cell are no sum over its points.
    modes : SoftModes
    means : Softening or None
        By the means over cells; None as `fields`.
    stress : CellStress or None
        None if the forces of a cell are no sum over its points.
    """

    equilibrium: Equilibrium
    compliance: CarriedCompliance
    fields: CellFields | None
    modes: SoftModes
    means: Softening | None
    stress: CellStress | None

    @classmethod
    def of(cls, equilibrium: Equilibrium) -> DrivenBody:
        """Make what does not depend on the load."""
        solid = equilibrium.solid
        known = CellStress.is_known(solid)
        fields, stress = (CellFields(equilibrium), CellStress(solid)) if known else (None, None)
        by_points = fields if type(solid) is Solid else None
        compliance = CarriedCompliance(equilibrium)
        modes, means = SoftModes(equilibrium, by_points, compliance.linear_response), None
        if by_points is not None:
            of_cells = CellFields(equilibrium, means=True)
            means = Softening(of_cells, modes.modes, modes.energies)
        if iterates(equilibrium.layout):
            equilibrium = equilibrium.iterating(compliance.at)
        return cls(equilibrium, compliance, fields, modes, means, stress)

    def under(self, pressure: FollowerPressure | None) -> DrivenBody:
        """Return the same body, under the pressures of one load case as well."""
        if pressure is None:
            return self
        return replace(self, equilibrium=self.equilibrium.under(pressure))

    def state(self, u: Array, force: Array) -> State | None:
        """State of a displacement under dead forces in N, (n_points, d) each.

        None if a cell is inverted or a number is not finite.
        """
        found = self._internal_forces(u) if np.isfinite(u).all() else None
        if found is None:
            return None
        internal, *at_points = found
        r = (internal - self.equilibrium.external(u[None], force[None])[0]) * self.equilibrium.free
        return State(u, r, *at_points) if np.isfinite(r).all() else None

    def softened(self, u: Array) -> float:
        """Smallest θ of the soft modes at a displacement, by the means over cells alone.

        −∞ under pressures that follow the body, where cells are inverted, and for elements whose
        forces are no sum over points.
        """
        dead = type(self.equilibrium) is Equilibrium and self.equilibrium.pressure is None
        if self.means is None or self.stress is None or not dead:
            return -np.inf
        f = self.means.fields.deformation_gradient(u)
        piola = self.stress(f)
        if piola is None:
            return -np.inf
        return float(self.means.quotients(f, piola).min(initial=1.0))

    def is_inverted(self, u: Array) -> bool:
        """Whether a displacement (n_points, d) inverts a cell."""
        if self.fields is None:
            return bool(self.equilibrium.inverted(u[None])[0])
        return not bool((jacobian(self.fields.deformation_gradient(u))[0] > 0).all())

    def _internal_forces(self, u: Array) -> tuple[Array, ...] | None:
        """f_int in N, (n_points, d), then F and P if they are all; None if a cell is inverted."""
        solid = self.equilibrium.solid
        if self.fields is None or self.stress is None:
            one = torch.from_numpy(u[None])
            inverted = bool(solid.inverted(one)[0])
            return None if inverted else (solid.internal_forces(one)[0].numpy(),)
        f = self.fields.deformation_gradient(u)
        piola = self.stress(f)
        if piola is None:
            return None
        forces = self.fields.forces(piola)
        return (forces, f, piola) if type(solid) is Solid else (forces,)
