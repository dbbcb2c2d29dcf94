r"""Directions towards the equilibrium, one by one, until the prediction is right enough.

The length of a direction (`surrogate.mechanics.descent.directions`) estimates the error of u. Where
the directions are not to be trusted (`surrogate.mechanics.descent.trust`), K(u) itself is
factorised, and steps of Newton's method decide. The last direction is still taken, since it is
there; what it leaves is not looked at, and as a rule far less than the estimate.

.. math:: δ = -K(u)^{-1} r(u), \qquad \bar δ = -K(u)^{-1} r(u + δ)

A state is settled as that of a full certificate is
(`surrogate.mechanics.certify.full_certificate`): K(u) is positive definite, the simplified step
:math:`\bar δ` is at most a quarter of δ, and one more simplified step contracts as well. The error
of u + δ is then nearly :math:`-\bar δ`, whose length is the estimate, and :math:`u + δ + \bar δ`
leaves far less. A state without stiffness along some direction, or one that does not settle, is
never within a tolerance.

A load series knows how much its last term changes it, which is more than what it leaves out as long
as its terms fall. Where this is small, the stresses soften no mode, and little of the load is out
of balance, no direction is needed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.units import Units
from surrogate.mechanics.descent.aim import Aim
from surrogate.mechanics.descent.directions import Directions
from surrogate.mechanics.descent.driven_body import DrivenBody, State, longest
from surrogate.mechanics.descent.trust import MARGIN, Trust
from surrogate.mechanics.equilibrium.newton_steps import norms

Array = NDArray[np.float64]
LAST = 0.7  # of the tolerance: largest last term of a series that needs no direction
MOST, MOST_STEPS = 100, 10  # directions, and steps of Newton's method after them
FAR = 0.1  # of the largest displacement: direction beyond which another start is looked at


@dataclass(frozen=True)
class Descent:
    """How directions ended.

    Attributes
    ----------
    directions : int
        Number of directions that were computed, with steps of Newton's method.
    estimate : float
        Estimated error of the node that is worst, in m: the length of the last direction.
    allowed : float
        Error in m that the tolerance allows; 0 without one.
    reached : bool or None
        Whether the estimate is within the tolerance, in a stable state; None without one.
    stable : bool
        False if directions have ended at a state that is found not to be stable.
    """

    directions: int
    estimate: float
    allowed: float
    reached: bool | None
    stable: bool = True

    @property
    def kept(self) -> bool:
        """Whether the prediction itself was within the tolerance, by one direction at most."""
        return self.directions <= 1 and self.reached is True

    def refusal(self, units: Units) -> str:
        """Say why the tolerance is not reached."""
        if not self.stable:
            return f"after {self.directions} directions, the state that they lead to is not stable"
        estimate, allowed = units.written(self.estimate), units.written(MARGIN * self.allowed)
        return (
            f"the tolerance is not reached after {self.directions} directions: estimated error "
            f"{estimate}, expected at most {allowed} by several in a row together"
        )

    def summary(self, units: Units | None) -> str:
        """Describe the directions in a few words, with their estimate if units are given."""
        what = "1 direction" if self.directions == 1 else f"{self.directions} directions"
        if units is None:
            return what
        return f"{what}, estimated error {units.written(self.estimate)} by the last one"


def descend(
    body: DrivenBody,
    force: Array,
    predicted: Array,
    aim: Aim,
    last_term: float = math.inf,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Array, Descent]:
    """Drive a prediction towards the equilibrium.

    Parameters
    ----------
    body : DrivenBody
    force, predicted : array, (n_nodes, d)
        A dead load in N, what acts between the nodes after the nodal forces, and displacements in m
        at the nodes. A prediction may be wrong, have inverted cells or be no number: where its
        first direction is long, the directions begin at the warped linear response, if that is
        nearer.
    aim : Aim
    last_term : float
        What the last term of the prediction's series adds at most, in m; infinite if it is not one.
    clock : callable
        Seconds, for the budget.

    Returns
    -------
    array, (n_nodes, d)
        The displacement in m; where the tolerance is not reached, that of least estimate.
    Descent
    """
    begun, equilibrium = clock(), body.equilibrium
    nodes, ((f,), (start,)) = equilibrium.nodes, equilibrium.posed(force[None], predicted[None])
    directions, trust = Directions(body, f), Trust(body, f)
    allowed = aim.allowed(longest(start[:nodes]))
    state = body.state(start, f)
    small = aim.tolerance is not None and last_term < LAST * allowed
    if small and state is not None and trust.needs_no_direction(state):
        return start[:nodes], Descent(0, last_term, allowed, reached=True)
    state = state or body.from_linear_response(f)
    d, size, first = directions.direction(state), longest(state.u[:nodes]), 1
    far = max(FAR * size, MARGIN * aim.allowed(size))
    if longest(d[:nodes]) > far and aim.has_time(clock() - begun):
        other = body.from_linear_response(f)
        d_other, first = directions.direction(other), 2
        if longest(d_other[:nodes]) < longest(d[:nodes]):
            state, d = other, d_other
    best, least = state.u, np.inf
    for count in range(first, MOST + 1):
        estimate, allowed = longest(d[:nodes]), aim.allowed(longest(state.u[:nodes]))
        if estimate <= least:
            best, least = state.u, estimate
        balanced = body.is_balanced(state, f)
        enough = trust.are_short(state, estimate, allowed, count) or balanced
        small = aim.tolerance is not None and estimate <= MARGIN * allowed
        if small and enough and trust.is_stiff(state):
            for last in (state.u + d, state.u):
                if not body.is_inverted(last):
                    return last[:nodes], Descent(count, estimate, allowed, reached=True)
        if balanced or not aim.has_time(clock() - begun):
            break
        if small and (enough or trust.has_ended(count)):
            break
        found = directions.step(state, d)
        if found is None and not directions.forget():
            break
        state = found or state
        d = directions.direction(state)
    if aim.tolerance is not None and aim.has_time(clock() - begun):
        u, end = settle(directions, state, aim, lambda: aim.has_time(clock() - begun), count)
        if end.reached or end.estimate < least or not end.stable:
            return u[:nodes], end
    return best[:nodes], Descent(count, least, allowed, None if aim.tolerance is None else False)


def settle(
    directions: Directions, state: State, aim: Aim, has_time: Callable[[], bool], before: int = 0
) -> tuple[Array, Descent]:
    """Go on from a state in doubt by steps of Newton's method until they settle.

    Parameters
    ----------
    directions : Directions
        Of the load.
    state : State
    aim : Aim
    has_time : callable
        Whether the budget allows another step.
    before : int
        Number of directions that were computed before.

    Returns
    -------
    array, (n_points, d)
        The displacement in m.
    Descent
    """
    body, f, equilibrium = directions.body, directions.force, directions.body.equilibrium
    nodes = equilibrium.nodes
    for count in range(before + 1, before + 1 + MOST_STEPS):
        found = equilibrium.newton_steps(state.u[None], f[None])
        step, size = found.steps[0], longest(state.u[:nodes])
        length, allowed = longest(step[:nodes]), aim.allowed(size)
        balanced, stable = body.is_balanced(state, f), bool(found.stable[0])
        if not stable and (balanced or length <= MARGIN * allowed):
            return state.u, Descent(count, length, allowed, False, stable=False)
        if stable and (balanced or found.contract(norms(found.steps))[0]):
            end, left = state.u + step, length
            if not balanced:
                end, left = end + found.simplified[0], longest(found.simplified[0, :nodes])
            if left <= MARGIN * allowed and not body.is_inverted(end):
                return end, Descent(count, left, allowed, True)
        after = directions.step(state, step) if has_time() else None
        if after is None:
            break
        state = after
    return state.u, Descent(count, length, allowed, False)
