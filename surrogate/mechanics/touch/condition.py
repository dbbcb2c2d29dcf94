r"""What is wanted of a body where forces are unknown: a grip's places held, or nothing in a tool.

Contact is a linear complementarity problem: which nodes bear a force, and which are apart.

.. math:: w = A λ + q, \qquad w \ge 0, \quad λ \ge 0, \quad λ^T w = 0
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.touch.loaded_body import LinearBody

Array = NDArray[np.float64]


class Condition(ABC):
    """A condition on displacements u in m, (m,), of the components that bear forces f in N, (m,).

    Its class says what is missing beyond a part of the way to it (`missing`).
    """

    missing: ClassVar[str]

    @abstractmethod
    def wrong(self, u: Array, force: Array) -> float:
        """How far a state is from it, in m."""

    @abstractmethod
    def size(self, field: Array, wrong: float) -> float:
        """What tolerances are relative to, in m, of a field that was wrong by so much at first."""

    @abstractmethod
    def forces(self, body: LinearBody, u: Array, force: Array) -> Array | None:
        """Forces in N with which the linear body around a state fulfils it; None if none do."""

    @abstractmethod
    def felt(self, body: LinearBody, change: Array, u: Array, force: Array) -> float:
        """How much forces would change with a change of u in m, over their size."""

    @abstractmethod
    def on_the_way(self, share: float, u: Array) -> Self:
        """Return a condition at some part of the way from displacements in m to this one."""

    @abstractmethod
    def moved_from(self, last: Self | None, u: Array, force: Array) -> Array:
        """How it has moved since the last frame, (m,) in m; u and the forces are those of that."""


@dataclass(frozen=True)
class Held(Condition):
    """Components that are held: u is the target in m, (m,)."""

    target: Array
    missing = "no equilibrium of the held body is found beyond {:.0%} of the displacement"

    def wrong(self, u: Array, force: Array) -> float:
        """Return the largest component of the residual."""
        return float(np.abs(self.target - u).max())

    def size(self, field: Array, wrong: float) -> float:
        """Return the largest held displacement, or the first residual."""
        return max(float(np.abs(self.target).max()), wrong)

    def forces(self, body: LinearBody, u: Array, force: Array) -> Array:
        """Return f + C⁻¹ (target − u)."""
        return force + body.forces_for(self.target - u)

    def felt(self, body: LinearBody, change: Array, u: Array, force: Array) -> float:
        """Return what the change takes, over the forces that there are."""
        taken = np.linalg.norm(body.forces_for(change))
        return float(taken / (np.linalg.norm(force) or 1.0))

    def on_the_way(self, share: float, u: Array) -> Held:
        """Return the target on a straight line."""
        return Held(u + share * (self.target - u))

    def moved_from(self, last: Held | None, u: Array, force: Array) -> Array:
        """Return the change of the target, from rest if there was none."""
        return self.target if last is None else self.target - last.target


BLOCKS = 5  # exchanges of many unknowns that may bring no progress
MOST = 300  # exchanges at all


def solve_complementarity(matrix: Array, offset: Array, begins: NDArray[np.bool_]) -> Array | None:
    """Solve by block principal pivoting (Portugal, Júdice and Vicente 1994, *Math. Comp.* 63).

    All unknowns on the wrong side are exchanged at once; where that makes no progress, only the
    last of them, which always ends for matrices of positive principal minors (Murty 1974).

    Parameters
    ----------
    matrix, offset : array, (n, n) and (n,)
        A and q.
    begins : array of bool, (n,)
        Unknowns that are not 0 at first.

    Returns
    -------
    array, (n,), or None
        λ; None if no solution is found.
    """
    inside, best, left = begins.copy(), len(offset) + 1, BLOCKS
    slack = 1e-12 * max(float(np.abs(offset).max(initial=0.0)), 1e-300)
    for _ in range(MOST):
        found = np.zeros(len(offset))
        part = np.flatnonzero(inside)
        try:
            found[part] = np.linalg.solve(matrix[np.ix_(part, part)], -offset[part])
        except np.linalg.LinAlgError:
            return None
        apart = matrix @ found + offset
        wrong = np.flatnonzero(np.where(inside, found < 0, apart < -slack))
        if not len(wrong):
            return found
        if len(wrong) < best:
            best, left = len(wrong), BLOCKS
        elif left:
            left -= 1
        else:
            wrong = wrong[-1:]
        inside[wrong] = ~inside[wrong]
    return None
