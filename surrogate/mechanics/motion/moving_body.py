"""A body in steps of one length, with some places held: what is made once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg

from shared_schema.common.errors import WorkError
from surrogate.mechanics.descent.driven_body import BodyOfStates
from surrogate.mechanics.descent.turned_compliance import TurnedCompliance
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.equilibrium.inertia import Inertia, Masses
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
CLOSE = 1e-12  # relative residual of an acceleration
ROUNDS = 12  # of inverse iteration for a frequency


@dataclass(frozen=True)
class MovingBody:
    """A body in steps of one length.

    Attributes
    ----------
    equilibrium : Equilibrium
        At rest, with the places held.
    masses : Masses
        In steps of this length.
    """

    equilibrium: Equilibrium
    masses: Masses

    @cached_property
    def driven(self) -> BodyOfStates:
        """The body as directions see it, in a step from rest."""
        zero = np.zeros(self.equilibrium.free.shape)
        body = self.equilibrium.moving(Inertia.of(self.masses, zero, zero, zero, zero))
        for once in ("undeformed", "round_off"):  # copies of all steps have them
            getattr(body, once)
        return BodyOfStates(body, TurnedCompliance(body))

    def in_step(self, step: Inertia, following: FollowingLoads | None) -> BodyOfStates:
        """The body in one step, under loads that follow it."""
        body = replace(self.driven, equilibrium=self.driven.equilibrium.moving(step))
        return body.under(following)

    @cached_property
    def frequency(self) -> float:
        """Frequency ω in 1/s of the slowest small vibration, by inverse iteration from falls."""
        points, d = self.equilibrium.free.shape
        u: Array = np.eye(d)[:, None] + np.zeros((d, points, d))
        for _ in range(ROUNDS):
            pull = np.stack([self.masses.matrix @ each for each in u])
            u = self.equilibrium.linear_response(pull)
            kinetic = [float(np.vdot(each, self.masses.matrix @ each)) for each in u]
            squares = [np.vdot(*each[:2]) / each[2] for each in zip(u, pull, kinetic, strict=True)]
            u /= np.sqrt(kinetic)[:, None, None]
        return float(np.sqrt(min(squares)))

    def acceleration(self, force: Array) -> Array:
        """M⁻¹ f in m/s² at free components, 0 at others: (n_points, d) in N → same."""
        free, found = self.equilibrium.free, np.zeros(force.shape)
        diagonal = self.masses.diagonal
        for component, (some, of) in enumerate(zip(free.T, force.T, strict=True)):
            if not of[some].any():
                continue
            matrix, inverse = self.masses.matrix[some][:, some], 1 / diagonal[some]
            scaled = LinearOperator(matrix.shape, matvec=lambda x, by=inverse: by * x)
            solved, missing = cg(matrix, of[some], rtol=CLOSE, M=scaled)
            if missing:
                raise WorkError("the accelerations of the body are not found")
            found[some, component] = solved
        return found
