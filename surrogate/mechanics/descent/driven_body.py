"""A body as directions see it: out-of-balance forces of single states, and the inverse of tangents.

What does not depend on the load is made once. Forces and stresses are those of compiled loops
(`surrogate.mechanics.compiled.solid`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.equilibrium import ForceTolerance
from surrogate.mechanics.compiled.solid import CompiledSolid
from surrogate.mechanics.descent.carried_compliance import CarriedCompliance
from surrogate.mechanics.descent.soft_modes import Softening, least_eigenvalue, soft_modes
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

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
    f, piola : array
        F and P in Pa at the points of the cells, in rows (`surrogate.mechanics.compiled.loops`).
    """

    u: Array
    r: Array
    f: Array
    piola: Array


class Inverse(Protocol):
    """What directions are made with."""

    def at(self, u: Array) -> Callable[[Array], Array]:
        """P of a state (n_points, d) in m: forces in N to displacements in m, (n_points, d)."""


@dataclass(frozen=True)
class BodyOfStates:
    """A body, state by state.

    Attributes
    ----------
    equilibrium : Equilibrium
        Also under the pressures of a load.
    compliance : Inverse
    """

    equilibrium: Equilibrium
    compliance: Inverse

    @property
    def solid(self) -> CompiledSolid:
        """Its elements."""
        return self.equilibrium.solid.compiled

    def under(self, following: FollowingLoads | None) -> Self:
        """Return the same body, under the pressures of one load case as well."""
        if following is None:
            return self
        return replace(self, equilibrium=self.equilibrium.under(following))

    def state(self, u: Array, force: Array) -> State | None:
        """State of a displacement under dead forces in N, (n_points, d) each.

        None if a cell is inverted or a number is not finite.
        """
        f, piola, internal, inside = self.solid.stressed(u)
        if not inside:
            return None
        external = self.equilibrium.external(u[None], force[None])[0]
        r = (internal - external) * self.equilibrium.free
        return State(u, r, f, piola) if np.isfinite(r).all() else None

    def is_dead(self) -> bool:
        """Whether the forces of loads do not follow it, nor points between its nodes."""
        return self.equilibrium.points is None and self.equilibrium.following is None

    def product(self, state: State, force: Array, x: Array) -> Array | None:
        """K(u) x in N of a change x in m by a difference of r; None where that inverts a cell.

        All are (n_points, d).
        """
        part = SMALL * self.equilibrium.cell_size / longest(x)
        beside = self.state(state.u + part * x, force)
        return None if beside is None else (beside.r - state.r) / part

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
        (`surrogate.mechanics.equilibrium.quadratic`): if that inverts a cell, the nodes do not tell
        the state.
        """
        nodes = self.equilibrium.nodes
        if nodes < len(u):
            interpolated = self.equilibrium.interpolated(u[None, :nodes])[0]
            if not self.solid.deformed(interpolated).inside:
                return True
        return not self.solid.deformed(u).inside


@dataclass(frozen=True)
class DrivenBody(BodyOfStates):
    """A body whose predictions are driven towards the equilibrium.

    Attributes
    ----------
    compliance : CarriedCompliance
    modes : array, (n_modes, n_points, d)
        The softest ones, of unit φ · K(0) φ.
    softening : Softening
    """

    compliance: CarriedCompliance
    modes: Array
    softening: Softening

    @classmethod
    def of(cls, equilibrium: Equilibrium) -> DrivenBody:
        """Make what does not depend on the load."""
        compliance = CarriedCompliance(equilibrium)
        modes = soft_modes(equilibrium, compliance.linear_response)
        softening = Softening(equilibrium.solid.compiled, modes)
        return cls(equilibrium, compliance, modes, softening)

    def from_linear_response(self, force: Array) -> State:
        """The warped linear response, or the largest part of it that inverts no cell."""
        equilibrium, warped = self.equilibrium, self.compliance.warped
        linear = equilibrium.linear_response(equilibrium.at_rest(force[None]))[0]
        while (found := self.state(warped(linear), force)) is None:
            linear = linear / 2
        return found

    def softest(self, state: State, force: Array) -> float:
        """θ of a state under dead forces in N, (n_points, d): by products where stresses soften."""
        if (softened := self.softened(state)) >= SOFT:
            return softened
        stiffness = np.zeros((len(self.modes),) * 2)
        carried = self.compliance.turned(state.u, self.modes)
        for row, s in zip(stiffness, carried, strict=True):
            if (tangent := self.product(state, force, s)) is None:
                return -np.inf
            row[:] = [np.vdot(each, tangent) for each in carried]
        return least_eigenvalue((stiffness + stiffness.T) / 2)

    def softened(self, state: State) -> float:
        """θ of a state by its stresses alone; −∞ where a cell is inverted in the mean."""
        return self.softening.least(state.f, state.piola)


def longest(field: Array) -> float:
    """Largest Euclidean norm of a node's vector in a field, (n_nodes, d)."""
    return float(np.sqrt(np.square(field).sum(axis=1).max(initial=0.0)))
