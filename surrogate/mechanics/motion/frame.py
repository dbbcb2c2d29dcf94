"""A frame of a body in motion: state, energies, and what acts on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from surrogate.mechanics.certify import Certificate
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.inertia import Masses
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moment:
    """State of a body at one time; all fields are at all points of its elements.

    Attributes
    ----------
    equilibrium : Equilibrium
        The body at rest, with its supports.
    masses : Masses
    u, v, a : array, (n_points, d)
        In m, m/s and m/s².
    dead, pushed : array, (n_points, d)
        Dead forces, and forces of a tool, in N.
    following : FollowingLoads or None
    left : array, (n_points, d)
        Forces out of balance without inertia R in N, at components that are not held.
    """

    equilibrium: Equilibrium
    masses: Masses
    u: Array
    v: Array
    a: Array
    dead: Array
    pushed: Array
    following: FollowingLoads | None
    left: Array

    @cached_property
    def external(self) -> Array:
        """All external forces in N."""
        found = self.dead + self.pushed
        return found if self.following is None else found + self.following.forces(self.u[None])[0]

    @cached_property
    def damping(self) -> Array:
        """Forces c M v + f_v in N, which take energy from the body."""
        masses, c = self.masses, self.masses.scheme.mass_damping
        found = masses.viscous_forces(self.u, self.v)
        return found + c * (masses.matrix @ self.v) if c else found

    @property
    def kinetic(self) -> float:
        """½ v · M v in J."""
        return float(np.vdot(self.v, self.masses.matrix @ self.v)) / 2

    @property
    def strain(self) -> float:
        """Energy of the material in J."""
        return float(self.equilibrium.solid.energy(torch.from_numpy(self.u[None]))[0])

    def left_of_free(self, body: Equilibrium) -> Array:
        """R in N of a body whose grips have just let go of places."""
        internal = self.equilibrium.solid.compiled.internal_forces(self.u[None])[0]
        return (internal + self.damping - self.external) * body.free

    @cached_property
    def supported(self) -> Array:
        """Forces of supports and grips on the body in N, zero where it is free."""
        internal = self.equilibrium.solid.compiled.internal_forces(self.u[None])[0]
        inertia = self.masses.matrix @ self.a
        held = internal + inertia + self.damping - self.external
        return np.where(self.equilibrium.free, 0.0, held)


@dataclass(frozen=True)
class Energies:
    """Energies in J.

    Attributes
    ----------
    kinetic, strain : float
    work : float
        Of loads, tools and grips since the begin, by the trapezoidal rule.
    dissipated : float
        By damping since then.
    drift : float
        What has come since then: kinetic + strain + dissipated − work, less what there was. The
        scheme makes it negative where ρ∞ is below 1.
    """

    kinetic: float
    strain: float
    work: float
    dissipated: float
    drift: float


@dataclass(frozen=True)
class Frame:
    """What a step has led to.

    Attributes
    ----------
    time : float
        In s.
    displacement, velocity : array, (n_nodes, d)
        In m and m/s.
    error : float
        Estimated error in m that this step adds, of the node that is worst; of its certificate, if
        it has one. What former steps have left goes on beside it.
    directions : int
        Number of directions that it took, and of Newton's steps.
    force : array, (n_nodes, d)
        Forces of the tool on the body in N.
    certificate : Certificate or None
        Of the equilibrium of the step, which takes all before it as given.
    """

    time: float
    displacement: Array
    velocity: Array
    error: float
    directions: int
    force: Array
    certificate: Certificate | None
    _moment: Moment
    _work: float
    _dissipated: float
    _first: Moment

    @property
    def reaction(self) -> Array:
        """Resultant of the tool on the body in N, (d,)."""
        return np.asarray(self.force.sum(axis=0))

    @cached_property
    def reactions(self) -> Array:
        """Forces of supports and grips on the body in N, (n_nodes, d)."""
        return self._moment.equilibrium.forces_at_nodes(self._moment.supported[None])[0]

    @cached_property
    def energies(self) -> Energies:
        """Energies in J, which are computed when they are asked for."""
        now, first = self._moment, self._first
        kinetic, strain = now.kinetic, now.strain
        drift = kinetic + strain + self._dissipated - self._work - first.kinetic - first.strain
        return Energies(kinetic, strain, self._work, self._dissipated, drift)
