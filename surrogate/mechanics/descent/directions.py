r"""Directions of one load, by the method of L-BFGS.

From a displacement u, with the out-of-balance forces r(u)
(`surrogate.mechanics.equilibrium.out_of_balance`), every direction is

.. math:: d = -H r, \qquad H ≈ K(u)^{-1}

(Nocedal and Wright, *Numerical Optimization*, 2006, Algorithm 7.4): the last
pairs of steps and changes of r correct the P of the present state
(`surrogate.mechanics.descent.carried_compliance`), from which the recursion begins. A direction
costs one residual and one P. The step is d itself, unless it inverts a cell, or the force along it
turns round; then it is shortened. No energy is needed, so that pressures which follow the surface
and every material are treated alike.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.linalg import norm
from numpy.typing import NDArray
from torch import Tensor

from surrogate.mechanics.descent.driven_body import BodyOfStates, State

Array = NDArray[np.float64]
Field = TypeVar("Field", Array, Tensor)
Result = TypeVar("Result")
Asking: TypeAlias = Generator[tuple[State, Array], Array, Result]  # for P of forces, at states
PAIRS = 16  # of steps and changes of r that are kept
SHORTENINGS = 12  # of a step
GROWN = 5.0  # of the forces out of balance: most that is left by a step
LEAST = 0.1  # of a step: what one shortening leaves, where the force along d rises steeply
TURNED = 0.9  # of the force along a direction: largest one of the other sign after a step
CURVED = 1e-8  # of the norms of a pair: smallest work of one that is kept


class Directions:
    """Directions of one load.

    Parameters
    ----------
    body : BodyOfStates
    force : array, (n_points, d)
        Dead forces in N.
    """

    def __init__(self, body: BodyOfStates, force: Array) -> None:
        self.body, self.force = body, force
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=PAIRS)

    def direction(self, state: State, r: Array | None = None) -> Array:
        """The direction d = −H r, (n_points, d) in m, along which r does negative work.

        r is that of the state, unless other forces in N are given.
        """
        asked = self.asking(state, state.r if r is None else r)
        try:
            request = next(asked)
            while True:
                request = asked.send(self.body.compliance.at(state.u)(request[1]))
        except StopIteration as end:
            return np.asarray(end.value)

    def asking(self, state: State, r: Array) -> Asking[Array]:
        """−H of forces r; it asks for P of what it yields, so that those of many are made at once.

        See `surrogate.mechanics.descent.equilibria`.
        """
        q, shares = backward(self._pairs, r, np.vdot)
        d = -forward(self._pairs, shares, (yield state, q), np.vdot)
        if self._pairs and not float(np.vdot(d, r)) < 0:
            self._pairs.clear()
            d = -(yield state, r)
        return d

    def step(self, state: State, d: Array) -> State | None:
        """Go along a direction; None if no part of it is good, and nothing is left to forget."""
        work, part = float(np.vdot(d, state.r)), 1.0
        if not work < 0:
            return None
        for _ in range(SHORTENINGS):
            found = self.body.state(state.u + part * d, self.force)
            if found is None or norm(found.r) > GROWN * norm(state.r):
                part /= 2
                continue
            after = float(np.vdot(d, found.r))
            if after <= -TURNED * work:
                self.remember(part * d, found.r - state.r)
                return found
            part *= max(LEAST, work / (work - after))  # no force along d there, if it is linear
        return None

    def forget(self) -> bool:
        """Leave the pairs out of the next direction; False if there are none."""
        some = bool(self._pairs)
        self._pairs.clear()
        return some

    def remember(self, s: Array, y: Array) -> None:
        """Keep a step in m and the change of r in N along it, (n_points, d) each."""
        work = float(np.vdot(s, y))
        if work > CURVED * float(np.linalg.norm(s)) * float(np.linalg.norm(y)):
            self._pairs.append((s, y, 1 / work))


def two_loops(
    pairs: Sequence[tuple[Field, Field, Any]],
    r: Field,
    carried: Callable[[Field], Field],
    dot: Callable[[Field, Field], Any],
) -> Field:
    """H r by the two loops of L-BFGS.

    Parameters
    ----------
    pairs : sequence of (s, y, 1 / s · y)
        Steps and changes of r, the oldest first.
    r : array or Tensor
    carried : callable
        P.
    dot : callable
        Product of two fields, of the kind of 1 / s · y.
    """
    q, shares = backward(pairs, r, dot)
    return forward(pairs, shares, carried(q), dot)


def backward(
    pairs: Sequence[tuple[Field, Field, Any]], r: Field, dot: Callable[[Field, Field], Any]
) -> tuple[Field, list[Any]]:
    """The first loop: what P is applied to, and the shares of the pairs, the newest first."""
    shares = []
    for s, y, inverse in reversed(pairs):
        shares.append(dot(s, r) * inverse)
        r = r - shares[-1] * y
    return r, shares


def forward(
    pairs: Sequence[tuple[Field, Field, Any]],
    shares: list[Any],
    found: Field,
    dot: Callable[[Field, Field], Any],
) -> Field:
    """The second loop, from what P has made of that."""
    for (s, y, inverse), share in zip(pairs, reversed(shares), strict=True):
        found = found + (share - dot(y, found) * inverse) * s
    return found
