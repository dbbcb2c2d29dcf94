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

from shared_schema.common.bodies.force_tolerance import ForceTolerance
from surrogate.descent.carried_compliance import CarriedCompliance
from surrogate.descent.cell_fields import CellFields, jacobian
from surrogate.descent.cell_stress import CellStress
from surrogate.descent.soft_modes import Softening, least_eigenvalue, soft_modes
from surrogate.mechanics.follower_pressure import FollowerPressure
from surrogate.mechanics.matrices.tangent_iterations import iterates
from surrogate.mechanics.newton_steps import NewtonSteps
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.solids.solid import Solid

Array = NDArray[np.float64]
EQUILIBRIUM = ForceTolerance()  # nothing is left to do
SOFT = 0.5  # θ below which a mode is soft
SMALL = 1e-5  # of the size of a cell: displacement along a mode


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
        F and P in Pa at the points of the cells; None if forces of a cell are no sum over these.
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
    modes : array, (n_modes, n_points, d)
        The softest ones, of unit φ · K(0) φ.
    softening : Softening or None
        By the means over cells; None if the forces of a cell are no sum over its points alone.
    stress : CellStress or None
        None if the forces of a cell are no sum over its points.
    """

    equilibrium: Equilibrium
    compliance: CarriedCompliance
    fields: CellFields | None
    modes: Array
    softening: Softening | None
    stress: CellStress | None

    @classmethod
    def of(cls, equilibrium: Equilibrium) -> DrivenBody:
        """Make what does not depend on the load."""
        solid = equilibrium.solid
        known = CellStress.is_known(solid)
        fields, stress = (CellFields(equilibrium), CellStress(solid)) if known else (None, None)
        compliance, softening = CarriedCompliance(equilibrium), None
        modes = soft_modes(equilibrium, compliance.linear_response)
        if type(solid) is Solid:
            softening = Softening(CellFields(equilibrium, dtype=np.float32, means=True), modes)
        if iterates(equilibrium.layout):
            equilibrium = equilibrium.iterating(compliance.at)
        return cls(equilibrium, compliance, fields, modes, softening, stress)

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

    def newton_steps(self, state: State, force: Array) -> NewtonSteps:
        """Steps from a state under dead forces in N, (n_points, d), with the factors of K(u)."""

        def residual(u: Array, force: Array) -> Array:
            found = self.state(u[0], force[0])
            return np.full(u.shape, np.nan) if found is None else found.r[None]

        return self.equilibrium.newton_steps(state.u[None], force[None], residual)

    def is_dead(self) -> bool:
        """Whether its forces do not follow it, and those of the cells are a sum over points."""
        dead = type(self.equilibrium) is Equilibrium and self.equilibrium.pressure is None
        return dead and self.softening is not None

    def softest(self, state: State, force: Array) -> float:
        """θ of a state under dead forces in N, (n_points, d): by products where stresses soften."""
        if self.softening is not None and (softened := self.softened(state)) >= SOFT:
            return softened
        stiffness = np.zeros((len(self.modes),) * 2)
        carried = self.compliance.turned(state.u, self.modes)
        for row, s in zip(stiffness, carried, strict=True):
            part = SMALL * self.equilibrium.cell_size / longest(s)
            beside = self.state(state.u + part * s, force)
            if beside is None:
                return -np.inf
            row[:] = [np.vdot(each, beside.r - state.r) / part for each in carried]
        return least_eigenvalue(stiffness)

    def softened(self, state: State) -> float:
        """θ of a state by its stresses alone; −∞ where a cell is inverted in the mean."""
        assert self.softening is not None
        assert self.stress is not None
        fields, f, piola = self.softening.fields, state.f, state.piola
        if f is None or f.shape[2] > len(fields.weights):  # several points of a cell
            f = fields.deformation_gradient(state.u).astype(np.float64)
            piola = self.stress(f)
        if piola is None:
            return -np.inf
        return self.softening.least(f.astype(fields.dtype), piola.astype(fields.dtype))

    def is_balanced(self, state: State, force: Array) -> bool:
        """Whether a state is in equilibrium, up to rounding."""
        equilibrium = self.equilibrium
        load = float(np.linalg.norm(equilibrium.at_rest(force[None]) * equilibrium.free))
        size = float(np.linalg.norm(state.u))
        allowed = EQUILIBRIUM.under(load, equilibrium.round_off, size)
        return float(np.linalg.norm(state.r)) <= allowed

    def is_inverted(self, u: Array) -> bool:
        """Whether a displacement (n_points, d) inverts a cell, or does so at its nodes alone.

        Where a result is used, points between the nodes are found from their interpolation
        (`surrogate.mechanics.quadratic`): if that inverts a cell, the nodes do not tell the state.
        """
        nodes = self.equilibrium.nodes
        if nodes < len(u) and self._inverts(self.equilibrium.interpolated(u[None, :nodes])[0]):
            return True
        return self._inverts(u)

    def _inverts(self, u: Array) -> bool:
        if self.fields is None:
            return bool(self.equilibrium.inverted(u[None])[0])
        return not bool((jacobian(self.fields.deformation_gradient(u))[0] > 0).all())

    def _internal_forces(self, u: Array) -> tuple[Array, ...] | None:
        """f_int in N, (n_points, d), and F and P if these make it; None if a cell is inverted."""
        solid = self.equilibrium.solid
        if self.fields is None or self.stress is None:
            one = torch.from_numpy(u[None])
            inverted = bool(solid.inverted(one)[0])
            return None if inverted else (np.asarray(solid.internal_forces(one)[0].numpy()),)
        f = self.fields.deformation_gradient(u)
        piola = self.stress(f)
        return None if piola is None else (self.fields.forces(piola), f, piola)


def longest(field: Array) -> float:
    """Largest Euclidean norm of a node's vector in a field, (n_nodes, d)."""
    return float(np.sqrt(np.square(field).sum(axis=1).max(initial=0.0)))
