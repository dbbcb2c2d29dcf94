r"""One step: directions from where the body coasts, until the rest is short.

A step is an equilibrium with springs to where the body coasts
(`surrogate.mechanics.equilibrium.inertia`), which hold it all the faster, the shorter the step is.
From u + h v, directions (`surrogate.mechanics.descent.directions`) lead there. What a direction d
leaves is about

.. math:: e = q \, |d|, \qquad q = \max_{i = n-1, n} |d_i| / |d_{i-1}|,

by the last two of n directions. A first one has the q of the last step that has taken several, of
`LEAST` or more. They end where e is within `MARGIN` of the tolerance. After `LOOKED` steps a second
one is taken for q. Where `MOST` directions do not suffice, steps of Newton's method do.

With a tool, forces that keep its surface free are sought after each direction
(`surrogate.mechanics.motion.contact`), and what they move is added to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.mechanics.descent.directions import Directions
from surrogate.mechanics.descent.driven_body import BodyOfStates, State, longest
from surrogate.mechanics.motion.contact import ToolForces

Array = NDArray[np.float64]
MOST, MOST_STEPS, HALVINGS = 30, 20, 6  # directions, Newton's steps after them, parts of a step
LOOKED = 8  # steps after which the contraction is looked at
LEAST, LARGEST = 0.05, 0.5  # contractions of which anything is concluded
MARGIN = 0.4  # of the tolerance: largest estimate that counts as small
NEWTON = 0.1  # of the allowed error: last step of Newton's method
NEAR = 0.1  # of the size of a cell: direction that inverts none
ROUNDING = 1e-14  # of the size of a cell: error of no consequence
SHORTER = "take shorter time steps"


@dataclass
class Contraction:
    """What directions of a session leave, from step to step.

    Attributes
    ----------
    left : float
        q; 1 where nothing is known.
    age : int
        Steps since it was found.
    """

    left: float = 1.0
    age: int = 0

    def expected(self, ratios: list[float]) -> float:
        """Q of a step, by the ratios of its directions so far; 1 where nothing is concluded."""
        if ratios:
            self.left, self.age = max(ratios[-2:]), 0
        reliable = self.age < LOOKED and self.left <= LARGEST
        return max(self.left, LEAST) if reliable else 1.0


@dataclass(frozen=True)
class Settled:
    """The end of a step.

    Attributes
    ----------
    u : array, (n_points, d)
        In m.
    estimate : float
        Estimated error in m of the point that is worst.
    directions : int
        Number of directions, and of Newton's steps, that it took.
    """

    u: Array
    estimate: float
    directions: int


def start_of(body: BodyOfStates, force: Array, starts: tuple[Array, ...]) -> State:
    """The first of some displacements, (n_points, d) in m, that inverts no cell.

    Raises
    ------
    WorkError
        If all do.
    """
    for start in starts:
        if (state := body.state(start, force)) is not None:
            return state
    raise WorkError(f"the motion inverts a cell of the body: {SHORTER}")


def settled(
    body: BodyOfStates,
    force: Array,
    state: State,
    tolerance: float,
    contraction: Contraction,
    tool: ToolForces | None = None,
) -> Settled:
    """Go to the end of a step.

    Parameters
    ----------
    body : BodyOfStates
        In the step.
    force : array, (n_points, d)
        Dead forces in N.
    state : State
    tolerance : float
        Error that is allowed, over the largest displacement.
    contraction : Contraction
    tool : ToolForces, optional
        Its forces become those at the end.

    Raises
    ------
    WorkError
        If no end is found.
    """
    directions, before, ratios = Directions(body, force), 0.0, list[float]()
    contraction.age += 1
    for count in range(1, MOST + 1):
        d = directions.direction(state, None if tool is None else state.r - tool.at_points)
        if before > 0:
            ratios.append(longest(d) / before)
        if tool is not None and (change := tool.answer(state.u + d)) is not None:
            d = d + directions.direction(state, -change)
        length, end = longest(d), state.u + d
        estimate = contraction.expected(ratios) * length
        allowed = max(tolerance * longest(end), ROUNDING * body.equilibrium.cell_size)
        fits = tool is None or tool.fits(end, allowed)
        near = length <= NEAR * body.equilibrium.cell_size
        if fits and estimate <= MARGIN * allowed and (near or not body.is_inverted(end)):
            return Settled(end, estimate, count)
        if tool is None and body.is_balanced(state, force):
            return Settled(state.u, length, count)
        found = directions.step(state, d) if tool is None else _part(directions, state, d)
        if found is None and not directions.forget():
            break
        state, before = found or state, length
    if tool is not None:
        raise WorkError(f"the forces of the tool are not found: {SHORTER}")
    return newton(body, force, state, tolerance, count)


def newton(
    body: BodyOfStates, force: Array, state: State, tolerance: float, before: int = 0
) -> Settled:
    """Go on by steps of Newton's method; WorkError if these do not end."""
    directions = Directions(body, force)
    for count in range(before + 1, before + 1 + MOST_STEPS):
        (step,), _ = body.equilibrium.newton_step(state.u[None], state.r[None])
        after = directions.step(state, step)
        if after is None:
            break
        length, state = longest(after.u - state.u), after
        if length <= NEWTON * tolerance * longest(state.u) or body.is_balanced(state, force):
            return Settled(state.u, length, count)
    raise WorkError(f"the end of a time step is not found: {SHORTER}")


def _part(directions: Directions, state: State, d: Array) -> State | None:
    """Go along a direction, or a part of it that inverts no cell; None if none is good."""
    for halving in range(HALVINGS):
        part = 0.5**halving * d
        if (found := directions.body.state(state.u + part, directions.force)) is not None:
            directions.remember(part, found.r - state.r)
            return found
    return None
