r"""When the directions of a load are to be trusted: they are short, and soft modes remain stiff.

The length of a direction estimates the error of u, if P is nearly the inverse of the tangent K(u).
It is too short along what P does not know to be soft: where stresses nearly make the body buckle,
or its material gives way. Directions of L-BFGS may even stay short for a while, until their pairs
tell of a soft direction. So directions are short enough if

- the first one is at most `FIRST` of the tolerance;
- or it is at most `MARGIN` θ of it, with the least stiffness θ of the softest modes
  (`surrogate.mechanics.descent.soft_modes`), and at most `LEFT` of the load is out of balance;
- or so many in a row are together at most `TOGETHER` of it, of the first `FEW`;

and the softest modes must keep at least `SOFT` of their stiffness. The last two do not hold where
the tangent has a narrow band, as that of a slender body, which has many soft directions. It is
factorised in the time of a few directions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.driven_body import SOFT, DrivenBody, State, longest
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
MARGIN = 0.4  # of the tolerance: largest estimate that counts as small
FIRST = 0.2  # of the tolerance: largest first direction that is enough
LEFT = 0.05  # of the load: largest forces out of balance beside a prediction that is nearly right
TOGETHER = {2: 0.1, 3: 0.2}  # of the tolerance, by the number of directions in a row
FEW = 14  # directions that may be enough
NARROW = 100  # of a band: largest width of one that is factorised in the time of a few directions
NEAR = 0.01  # of the largest displacement: distance of states whose modes are equally stiff


class Trust:
    """What the directions of one load tell of its error.

    Parameters
    ----------
    body : DrivenBody
    force : array, (n_points, d)
        Dead forces in N.
    """

    def __init__(self, body: DrivenBody, force: Array) -> None:
        self._body, self._force = body, force
        self._lengths: list[float] = []
        self._looked_at: State | None = None
        self._stiffness = 1.0
        self._is_narrow = is_narrow(body.equilibrium)

    def are_short(self, state: State, estimate: float, allowed: float, count: int) -> bool:
        """Whether the directions are short enough.

        Parameters
        ----------
        state : State
        estimate, allowed : float
            Length of its direction and the error that is allowed, in m.
        count : int
            Number of directions that were computed, with those of other states.
        """
        self._lengths.append(estimate)
        if count == 1 and estimate <= FIRST * allowed:
            return True
        if self.has_ended(count):
            return False
        if count == 1 and estimate <= MARGIN * allowed and self.is_nearly_balanced(state):
            return estimate <= MARGIN * self.stiffness(state) * allowed
        return any(
            len(self._lengths) >= number and sum(self._lengths[-number:]) <= part * allowed
            for number, part in TOGETHER.items()
        )

    def has_ended(self, count: int) -> bool:
        """Whether directions after so many are trusted no longer, so that K(u) is factorised."""
        return self._is_narrow or count > FEW

    def needs_no_direction(self, state: State) -> bool:
        """Whether little of a dead load is out of balance, and stresses soften no mode."""
        body = self._body
        return body.is_dead() and self.is_nearly_balanced(state) and body.softened(state) >= SOFT

    def is_stiff(self, state: State) -> bool:
        """Whether the softest modes keep enough of their stiffness."""
        return self.stiffness(state) >= SOFT

    def stiffness(self, state: State) -> float:
        """θ of the softest modes, 1 at most, which is that of states beside this one as well."""
        last, near = self._looked_at, NEAR * longest(state.u)
        if last is None or longest(state.u - last.u) > near:
            self._looked_at = state
            self._stiffness = min(1.0, self._body.softest(state, self._force))
        return self._stiffness

    def is_nearly_balanced(self, state: State) -> bool:
        """Whether little of the load is out of balance."""
        return float(np.linalg.norm(state.r)) <= LEFT * float(np.linalg.norm(self._force))


def is_narrow(equilibrium: Equilibrium) -> bool:
    """Whether the tangent is factorised in the time of a few directions."""
    width = equilibrium.layout.width
    return width is not None and width <= NARROW
