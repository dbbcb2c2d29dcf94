r"""Equilibria of many loads at once, by directions to the end.

Newton's method factorises a tangent at every state. Directions
(`surrogate.mechanics.descent.directions`) go on to the equilibrium with factors of the undeformed
body alone, and solves for many loads at once read these only once. So the search of every load is a
generator that asks for P of forces at a state, and the searches of many loads go on in step.

A state is the equilibrium if its forces out of balance are within the tolerance, and the direction
that has led to it is at most `CLOSE` of the largest displacement. Whether it is stable is found as
`datagen` does (`datagen.stability`): conjugate gradients on K(u) x = b with random b, and with the
H of the directions as preconditioner, meet a direction of negative curvature, or their residual
falls to a hundredth in the norm of H, which it does not where b has a part along a direction that
loses energy.

Where directions end before, meet an unstable state or do not tell, there is no result: a correction
(`surrogate.mechanics.certify.correction`) finds the equilibrium with tangents.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.equilibrium import ForceTolerance
from surrogate.mechanics.descent.carried_compliance import CarriedCompliance
from surrogate.mechanics.descent.descent import FAR, MOST
from surrogate.mechanics.descent.directions import Asking, Directions
from surrogate.mechanics.descent.driven_body import DrivenBody, State, longest

Array = NDArray[np.float64]
AT_ONCE = 32  # searches, whose solves are made together
CLOSE = 2e-9  # of the largest displacement: largest last direction, which leaves less than half
REDUCTION, PRODUCTS = 1e-2, 60  # of the residual in the norm of H, and most products that it takes


@dataclass(frozen=True)
class Equilibrated:
    """A stable equilibrium.

    Attributes
    ----------
    displacement : array, (n_nodes, d)
        In m.
    directions : int
        Number of directions that have led to it.
    residual_norm : float
        ‖r‖₂ in N.
    """

    displacement: Array
    directions: int
    residual_norm: float


def equilibria(
    compliance: CarriedCompliance, searches: Iterable[Asking[Equilibrated | None]]
) -> Iterator[tuple[int, Equilibrated | None]]:
    """Yield the number of each search and what it has found, in the order in which they end.

    Parameters
    ----------
    compliance : CarriedCompliance
        That of the body of all searches.
    searches : iterable
        Of `sought`; the next one begins when another has ended.
    """
    numbered = enumerate(searches)
    running: dict[int, Asking[Equilibrated | None]] = {}
    answers: dict[int, Any] = {}  # None is what begins a search
    while True:
        for number, search in numbered if len(running) < AT_ONCE else ():
            running[number], answers[number] = search, None
            if len(running) == AT_ONCE:
                break
        if not running:
            return
        asked = {}
        for number, answer in answers.items():
            try:
                asked[number] = running[number].send(answer)
            except StopIteration as end:
                del running[number]
                yield number, end.value
        answers = {}
        if asked:
            states, forces = zip(*asked.values(), strict=True)
            found = compliance.at_each([state.u for state in states], forces)
            answers = dict(zip(asked, found, strict=True))


def sought(
    body: DrivenBody, force: Array, predicted: Array, tolerance: ForceTolerance
) -> Asking[Equilibrated | None]:
    """Search for the stable equilibrium next to a prediction; None if directions do not find it.

    Parameters
    ----------
    body : DrivenBody
    force, predicted : array, (n_nodes, d)
        As of `surrogate.mechanics.descent.descend`.
    tolerance : ForceTolerance
    """
    equilibrium = body.equilibrium
    nodes, ((f,), (start,)) = equilibrium.nodes, equilibrium.posed(force[None], predicted[None])
    load = float(np.linalg.norm(equilibrium.at_rest(f[None]) * equilibrium.free))
    directions = Directions(body, f)
    state = body.state(start, f) or body.from_linear_response(f)
    d = yield from directions.asking(state, state.r)
    if longest(d[:nodes]) > FAR * longest(state.u[:nodes]):
        other = body.from_linear_response(f)
        d_other = yield from directions.asking(other, other.r)
        if longest(d_other[:nodes]) < longest(d[:nodes]):
            state, d = other, d_other
    for count in range(1, MOST + 1):
        found = directions.step(state, d)
        state, moved = found or state, longest(d if found is None else found.u - state.u)
        allowed = tolerance.under(load, equilibrium.round_off, float(np.linalg.norm(state.u)))
        left = float(np.linalg.norm(state.r))
        if moved <= CLOSE * longest(state.u) and left <= allowed:
            stable = yield from is_stable(directions, state)
            return Equilibrated(state.u[:nodes], count, left) if stable else None
        if found is None and not directions.forget():
            return None
        d = yield from directions.asking(state, state.r)
    return None


def is_stable(directions: Directions, state: State) -> Asking[bool]:
    """Whether K(u) is positive definite; False also where the products do not tell.

    Under pressures, which make it unsymmetric, its symmetric part is factorised.
    """
    body, force = directions.body, directions.force
    if body.equilibrium.following is not None:
        return body.equilibrium.response_at(state.u) is not None
    r = np.random.default_rng(0).standard_normal(force.shape) * body.equilibrium.free
    p = z = -(yield from directions.asking(state, r))
    square = float(np.vdot(r, z))
    enough = REDUCTION**2 * square
    for _ in range(PRODUCTS):
        product = body.product(state, force, p)
        curvature = -np.inf if product is None else float(np.vdot(p, product))
        if product is None or not curvature > 0:
            return False
        r = r - square / curvature * product
        z = -(yield from directions.asking(state, r))
        before, square = square, float(np.vdot(r, z))
        if square <= enough:
            return True
        p = z + square / before * p
    return False
