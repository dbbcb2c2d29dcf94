r"""Directions towards the equilibrium, one by one, until the estimated error is small enough.

From a predicted displacement u, with the out-of-balance forces r(u)
(`surrogate.mechanics.out_of_balance`), every direction is

.. math:: d = -H r, \qquad H ≈ K(u)^{-1},

by the L-BFGS method (Nocedal and Wright, *Numerical Optimization*, 2006, Algorithm 7.4): the last
pairs of steps and changes of r correct the P of the present state
(`surrogate.descent.carried_compliance`), from which the recursion begins. A direction costs one
residual and one P. The step is d itself, unless it inverts a cell, or the force along it turns
round; then it is shortened. No energy is needed, so that pressures which follow the surface and
every material are treated alike.

The length of d estimates the error of u. It may be too small where the body is nearly unstable,
since P knows no buckling. Directions therefore stop only when two in a row are below `MARGIN`
of the tolerance, or the first one is. Then the softest modes of the body are looked at: where the
stresses soften one, the change of r along it joins the pairs, and the next direction must be small
as well; a mode without stiffness says that the state is not stable
(`surrogate.descent.soft_modes`). This last direction is still taken, since it is there; what
it leaves is not looked at, and as a rule far less than the estimate.

A load series knows how much its last term changes it, which is more than what it leaves out as long
as its terms fall. Where this is small and the stresses soften no mode, no direction is needed.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.force_tolerance import ForceTolerance
from shared_schema.common.keys.units import Units
from surrogate.descent.aim import Aim
from surrogate.descent.driven_body import DrivenBody, State
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
PAIRS = 8  # of steps and changes of r that are kept
MARGIN = 0.4  # of the tolerance: largest direction that counts as small
LAST = 0.7  # of the tolerance: largest last term of a series that needs no direction
IN_A_ROW = 2  # small directions after a step
MOST = 100  # directions
SHORTENINGS = 12  # of a step
TURNED = 0.9  # of the force along a direction: largest one of the other sign after a step
CURVED = 1e-8  # of the norms of a pair: smallest work of one that is kept
SOFT = 0.5  # θ below which a mode is looked at, and corrects directions
CRITICAL = 0.25  # θ below which the whole tangent tells whether a state is stable
SMALL = 1e-5  # of the size of a cell: displacement along a mode
FAR = 0.1  # of the largest displacement: direction beyond which another start is looked at
EQUILIBRIUM = ForceTolerance()  # nothing is left to do


@dataclass(frozen=True)
class Descent:
    """How directions ended.

    Attributes
    ----------
    directions : int
        Number of directions that were computed.
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
            f"{estimate}, expected at most {allowed} in {IN_A_ROW} of them in a row"
        )

    def summary(self, units: Units | None) -> str:
        """Describe the directions in a few words, with their estimate if units are given."""
        what = "1 direction" if self.directions == 1 else f"{self.directions} directions"
        if units is None:
            return what
        return f"{what}, estimated error {units.written(self.estimate)} by the last one"


class Directions:
    """Directions of one load.

    Parameters
    ----------
    body : DrivenBody
    force : array, (n_points, d)
        Dead forces in N.
    """

    def __init__(self, body: DrivenBody, force: Array) -> None:
        self.body, self.force = body, force
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=PAIRS)

    def from_linear_response(self) -> State:
        """The warped linear response, or the largest part of it that inverts no cell."""
        equilibrium, warped = self.body.equilibrium, self.body.compliance.warped
        linear = equilibrium.linear_response(equilibrium.at_rest(self.force[None]))[0]
        while (found := self.body.state(warped(linear), self.force)) is None:
            linear = linear / 2
        return found

    def direction(self, state: State) -> Array:
        """The direction d = −H r, (n_points, d) in m, along which r does negative work."""
        carried = self.body.compliance.at(state.u)
        d = self._recursion(carried, state.r)
        if self._pairs and not float(np.vdot(d, state.r)) < 0:
            self._pairs.clear()
            d = -carried(state.r)
        return d

    def step(self, state: State, d: Array) -> State | None:
        """Go along a direction; None if no part of it is good, and nothing is left to forget."""
        work, part = float(np.vdot(d, state.r)), 1.0
        for _ in range(SHORTENINGS):
            found = self.body.state(state.u + part * d, self.force)
            if found is None:
                part /= 2
                continue
            after = float(np.vdot(d, found.r))
            if after <= -TURNED * work:
                self._remember(part * d, found.r - state.r)
                return found
            part *= work / (work - after)  # where the force along d is zero, if it is linear
        return None

    def softest(self, state: State) -> float:
        """Smallest θ of the soft modes of a state; small ones are known to the next direction.

        Negative if the state is not stable (`surrogate.descent.soft_modes`).
        """
        modes, least = self.body.modes, 1.0
        looked = np.arange(len(modes.modes))
        if state.f is not None and state.piola is not None:
            assert modes.softening is not None
            softened = modes.softening.quotients(state.f, state.piola)
            looked, least = np.flatnonzero(softened < SOFT), float(softened.min(initial=1.0))
            least = max(least, SOFT) if len(looked) else least
        for number in looked:
            s = self.body.compliance.turned(state.u, modes.modes[number])
            part = SMALL * self.body.equilibrium.cell_size / longest(s)
            beside = self.body.state(state.u + part * s, self.force)
            if beside is not None:
                y = (beside.r - state.r) / part
                quotient = float(np.vdot(s, y)) / modes.energies[number]
                least = min(least, quotient)
                if quotient < SOFT:
                    self._remember(s, y)
        critical = 0 < least < CRITICAL  # quotients of modes at rest are not the smallest ones
        if critical and self.body.equilibrium.response_at(state.u) is None:
            return -least
        return least

    def forget(self) -> bool:
        """Leave the pairs out of the next direction; False if there are none."""
        some = bool(self._pairs)
        self._pairs.clear()
        return some

    def _remember(self, s: Array, y: Array) -> None:
        work = float(np.vdot(s, y))
        if work > CURVED * float(np.linalg.norm(s)) * float(np.linalg.norm(y)):
            self._pairs.append((s, y, work))

    def _recursion(self, carried: Callable[[Array], Array], r: Array) -> Array:
        """−H r by the two loops of L-BFGS."""
        q, shares = r, []
        for s, y, work in reversed(self._pairs):
            shares.append(float(np.vdot(s, q)) / work)
            q = q - shares[-1] * y
        found = carried(q)
        for (s, y, work), share in zip(self._pairs, reversed(shares), strict=True):
            found = found + (share - float(np.vdot(y, found)) / work) * s
        return -found


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
    nodes, f = equilibrium.nodes, equilibrium.forces_at_points(force[None])[0]
    directions = Directions(body, f)
    held = np.where(equilibrium.free[:nodes], predicted, 0.0)
    start = equilibrium.at_points(held[None], f[None])[0]
    allowed = aim.allowed(longest(start[:nodes]))
    known = aim.tolerance is not None and last_term <= LAST * allowed
    if known and body.softened(start) >= SOFT:
        return start[:nodes], Descent(0, last_term, allowed, reached=True)
    state = body.state(start, f) or directions.from_linear_response()
    d, size, first = directions.direction(state), longest(state.u[:nodes]), 1
    far = max(FAR * size, MARGIN * aim.allowed(size))
    if longest(d[:nodes]) > far and aim.has_time(clock() - begun):
        other = directions.from_linear_response()
        d_other, first = directions.direction(other), 2
        if longest(d_other[:nodes]) < longest(d[:nodes]):
            state, d = other, d_other
    best, least, small, stable, looked_at = state.u, np.inf, 0, True, None
    for count in range(first, MOST + 1):
        estimate, allowed = longest(d[:nodes]), aim.allowed(longest(state.u[:nodes]))
        if estimate <= least:
            best, least = state.u, estimate
        small = small + 1 if estimate <= MARGIN * allowed else 0
        balanced = is_balanced(equilibrium, f, state)
        reached = small >= (1 if count == 1 or balanced else IN_A_ROW)
        if reached and state is not looked_at:
            looked_at, softest = state, directions.softest(state)
            stable = softest > 0
            if stable and softest < SOFT:  # what is now known may make the direction longer
                d, small = directions.direction(state), small - 1
                continue
        if reached and not stable:
            reached = False
            break
        if reached:
            last = state.u + d
            best, least = state.u if body.is_inverted(last) else last, estimate
        if reached or balanced or not aim.has_time(clock() - begun):
            break
        found = directions.step(state, d)
        if found is None and not directions.forget():
            break
        state = found or state
        d = directions.direction(state)
    within = None if aim.tolerance is None else reached
    return best[:nodes], Descent(count, least, allowed, within, stable)


def is_balanced(equilibrium: Equilibrium, f: Array, state: State) -> bool:
    """Whether a state is in equilibrium, up to rounding."""
    load = float(np.linalg.norm(equilibrium.at_rest(f[None]) * equilibrium.free))
    size = float(np.linalg.norm(state.u))
    allowed = EQUILIBRIUM.under(load, equilibrium.round_off, size)
    return float(np.linalg.norm(state.r)) <= allowed


def longest(field: Array) -> float:
    """Largest Euclidean norm of a node's vector in a field, (n_nodes, d)."""
    return float(np.sqrt(np.square(field).sum(axis=1).max(initial=0.0)))
