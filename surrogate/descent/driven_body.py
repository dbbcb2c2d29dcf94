"""A body as directions see it: out-of-balance forces of single states, and the inverse of tangents.

What does not depend on the load is made once. Forces of solids that are a sum over quadrature
points are summed in compiled loops, in a third of the time; those whose cells change their
volumes as a whole are their own (`surrogate.mechanics.solids`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.material import NeoHookean
from surrogate.descent.carried_compliance import CarriedCompliance
from surrogate.descent.cell_fields import CellFields, jacobian
from surrogate.descent.soft_modes import Softening, SoftModes
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.hyperelastic import stress
from surrogate.mechanics.solids.solid import Solid
from surrogate.series.stress_series import Factors

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
    r"""A body whose predictions are driven towards the equilibrium.

    Attributes
    ----------
    equilibrium : Equilibrium
        Also under the pressures of a load.
    compliance : CarriedCompliance
    fields : CellFields or None
        None if the forces of a cell are no sum over its points.
    modes : SoftModes
    means : Softening or None
        By the means over cells; None as `fields`.
    factors : array, (3, n_cells), or None
        μ, g and d of the stress :math:`P = μ F + (g (J - 1) - μ + d (1 - 1 / J)) \, cof F` in Pa
        (`surrogate.series.stress_series`); None if a material is not Neo-Hookean.
    """

    equilibrium: Equilibrium
    compliance: CarriedCompliance
    fields: CellFields | None
    modes: SoftModes
    means: Softening | None
    factors: Array | None

    @classmethod
    def of(cls, equilibrium: Equilibrium) -> DrivenBody:
        """Make what does not depend on the load."""
        by_points = type(equilibrium.solid) is Solid
        fields = CellFields(equilibrium) if by_points else None
        modes, means = SoftModes(equilibrium, fields), None
        if by_points:
            of_cells = CellFields(equilibrium, means=True)
            means = Softening(of_cells, modes.modes, modes.energies)
        compliance, factors = CarriedCompliance(equilibrium), factors_of(equilibrium.solid)
        return cls(equilibrium, compliance, fields, modes, means, factors)

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
        if self.means is None or not dead:
            return -np.inf
        f = self.means.fields.deformation_gradient(u)
        piola = self._piola(f)
        if piola is None:
            return -np.inf
        return float(self.means.quotients(f, piola).min(initial=1.0))

    def is_inverted(self, u: Array) -> bool:
        """Whether a displacement (n_points, d) inverts a cell."""
        if self.fields is None:
            return bool(self.equilibrium.inverted(u[None])[0])
        return not bool((jacobian(self.fields.deformation_gradient(u))[0] > 0).all())

    def _internal_forces(self, u: Array) -> tuple[Array, ...] | None:
        """f_int in N, (n_points, d), then F and P if they are known; None if a cell is inverted."""
        solid = self.equilibrium.solid
        if self.fields is None:
            one = torch.from_numpy(u[None])
            inverted = bool(solid.inverted(one)[0])
            return None if inverted else (solid.internal_forces(one)[0].numpy(),)
        f = self.fields.deformation_gradient(u)
        piola = self._piola(f)
        return None if piola is None else (self.fields.forces(piola), f, piola)

    def _piola(self, f: Array) -> Array | None:
        """P in Pa of F at the points of the cells, (d, d, n) each; None if J is not positive."""
        j, cofactors = jacobian(f)
        if not bool((j > 0).all()):
            return None
        solid = self.equilibrium.solid
        if self.factors is None:
            of_cells = torch.from_numpy(f).reshape(*f.shape[:2], len(solid.cells), 1, -1)
            return solid.by_material(stress, of_cells).flatten(2).numpy()
        mu, growth, decay = np.repeat(self.factors, len(j) // self.factors.shape[1], axis=1)
        s = growth * (j - 1) - mu + decay * (1 - 1 / j)
        return np.asarray(mu * f + s * cofactors)


def factors_of(solid: Solid) -> Array | None:
    """Factors of the stress in the cells, (3, n_cells); None if a material is not Neo-Hookean."""
    materials = [material for material in solid.materials if isinstance(material, NeoHookean)]
    if len(materials) < len(solid.materials):
        return None
    return np.array([Factors.of(each) for each in materials]).T[:, solid.material_of_cells()]
