r"""Steps of Newton's method from a state in doubt, until they settle: its tangent is factorised.

.. math:: δ = -K(u)^{-1} r(u), \qquad \bar δ = -K(u)^{-1} r(u + δ)

A state is settled as that of a full certificate is
(`surrogate.mechanics.certify.full_certificate`): K(u) is positive definite, the simplified step
:math:`\bar δ` is at most a quarter of δ, and one more simplified step contracts as well. The error
of u + δ is then nearly :math:`-\bar δ`, whose length is the estimate, and :math:`u + δ + \bar δ`
leaves far less. A state without stiffness along some direction, or one that does not settle, is
never within a tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.descent.directions import Directions
from surrogate.mechanics.descent.driven_body import State, longest
from surrogate.mechanics.descent.trust import MARGIN
from surrogate.mechanics.equilibrium.newton_steps import norms

Array = NDArray[np.float64]
MOST = 10  # steps


@dataclass(frozen=True)
class Settled:
    """How the steps ended.

    Attributes
    ----------
    u : array, (n_points, d)
        In m.
    steps : int
        Number of factorised tangents.
    estimate, allowed : float
        In m, as of `surrogate.mechanics.descent.descent.Descent`.
    reached, stable : bool
        Likewise.
    """

    u: Array
    steps: int
    estimate: float
    allowed: float
    reached: bool
    stable: bool = True


def settle(directions: Directions, state: State, aim: Aim, has_time: Callable[[], bool]) -> Settled:
    """Go on from a state whose direction is small.

    Parameters
    ----------
    directions : Directions
        Of the load.
    state : State
    aim : Aim
    has_time : callable
        Whether the budget allows another step.
    """
    body, f, equilibrium = directions.body, directions.force, directions.body.equilibrium
    nodes = equilibrium.nodes
    for count in range(1, MOST + 1):
        found = equilibrium.newton_steps(state.u[None], f[None])
        step, size = found.steps[0], longest(state.u[:nodes])
        allowed, balanced = aim.allowed(size), body.is_balanced(state, f)
        is_small = balanced or longest(step[:nodes]) <= MARGIN * allowed
        stable = bool(found.stable[0])
        if not stable and is_small:
            return Settled(state.u, count, longest(step[:nodes]), allowed, False, stable=False)
        if stable and (balanced or found.contract(norms(found.steps))[0]):
            end, left = state.u + step, longest(step[:nodes])
            if not balanced:
                end, left = end + found.simplified[0], longest(found.simplified[0, :nodes])
            if left <= MARGIN * allowed and not body.is_inverted(end):
                return Settled(end, count, left, allowed, True)
        after = directions.step(state, step) if has_time() else None
        if after is None:
            break
        state = after
    return Settled(state.u, count, longest(step[:nodes]), allowed, False)
