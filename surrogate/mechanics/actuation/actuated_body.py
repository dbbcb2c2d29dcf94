"""A body under its actuators, in displacements or in modes, as `bordered` solves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.following_loads import FollowingLoad
from surrogate.mechanics.actuation.bordered import Residual
from surrogate.mechanics.actuation.reduced_body import ReducedBody
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
ROUNDING = 1e-9  # of the size of a cell


@dataclass(frozen=True)
class ActuatedBody:
    """All displacements of a body under actuators and a dead load.

    Attributes
    ----------
    equilibrium : Equilibrium
    units : tuple of FollowingLoad
    force : array, (n_points, d)
        In N.
    """

    equilibrium: Equilibrium
    units: tuple[FollowingLoad, ...]
    force: Array

    @property
    def signs(self) -> Array:
        """Those of g = ± ∂q/∂u."""
        return np.array([unit.sign for unit in self.units])

    @property
    def least(self) -> float:
        """Size in m of a step that rounding errors make."""
        return ROUNDING * self.equilibrium.cell_size

    def under(self, part: float) -> Self:
        """The body under a part of its dead load."""
        return replace(self, force=part * self.force)

    def residual(self, state: Array, amplitudes: Array) -> Residual | None:
        """Out-of-balance forces in N, of displacements (n_points · d,) in m."""
        body, shape = self.equilibrium, self.force.shape
        u = state.reshape(shape)
        if body.inverted(u[None])[0]:
            return None
        x = body.geometry.coordinates + u
        units = np.array([unit.forces(x) * body.free for unit in self.units])
        r = body.out_of_balance(u[None], self.force[None])[0] - np.tensordot(amplitudes, units, 1)
        quantities = np.array([unit.quantity(x) for unit in self.units])
        return Residual(r.ravel(), units.reshape(len(units), -1), quantities)

    def inverse_at(
        self, state: Array, amplitudes: Array, rough: bool = False
    ) -> Callable[[Array], Array]:
        """K⁻¹ by a factor."""
        shape = self.force.shape
        loads = FollowingLoads(self.equilibrium.geometry.coordinates, self.units, amplitudes[None])
        inverse, _ = self.equilibrium.under(loads).inverse_at(state.reshape(1, *shape))
        return lambda right: inverse(right.reshape(-1, *shape)).reshape(right.shape)


@dataclass(frozen=True)
class ActuatedModes:
    """Coefficients of modes of a body under actuators and a dead load.

    Attributes
    ----------
    body : ReducedBody
    work : array, (n_modes,)
        Of the dead load on the modes in J.
    measures : bool
        Whether lengths and volumes are asked for.
    tangent_near : callable or None
        Nearly K of the internal forces under some amplitudes, (n_modes, n_modes) in J.
    """

    body: ReducedBody
    work: Array
    measures: bool = True
    tangent_near: Callable[[Array], Array] | None = None

    @cached_property
    def signs(self) -> Array:
        """Those of g = ± ∂q/∂u."""
        return np.array([unit.sign for unit in self.body.units])

    @property
    def least(self) -> float:
        """Size in m of a step that rounding errors make."""
        return ROUNDING * self.body.equilibrium.cell_size

    def under(self, part: float) -> Self:
        """The body under a part of its dead load."""
        return replace(self, work=part * self.work)

    def residual(self, state: Array, amplitudes: Array) -> Residual | None:
        """Works of the out-of-balance forces on the modes in J."""
        internal = self.body.internal(state)
        if internal is None:
            return None
        units = self.body.following(state)
        quantities = self.body.quantities(state) if self.measures else np.ones(len(units))
        return Residual(internal - self.work - amplitudes @ units, units, quantities)

    def inverse_at(
        self, state: Array, amplitudes: Array, rough: bool = False
    ) -> Callable[[Array], Array]:
        """K⁻¹ in modes; a rough one is of the tangents of states nearby."""
        near = self.tangent_near if rough else None
        k = self.body.tangent(state) if near is None else near(amplitudes)
        inverse = np.linalg.inv(k - self.body.following_slopes(state, amplitudes))
        return lambda right: np.asarray(right @ inverse.T)
