r"""Forces under which a body moves as it is told, by Broyden's method.

Sought are forces g with :math:`r(g) = \bar u - u_H(g) = 0`, where :math:`u_H(g)` is what is
predicted. With the change s of the forces and y of the residual's negative in a step,

.. math:: s = B r, \qquad B ← B + \frac{(s - B y) \, s^T B}{s^T B y}, \qquad
          B_0 = \big((K^{-1})_{HH}\big)^{-1}

The stiffness at rest, :math:`B_0`, follows from the columns of :math:`K^{-1}`. Where a step makes
the residual larger, a part of it is taken; where that does not help, B is measured by small changes
of the forces, and the displacement is applied in steps (Broyden, *A class of methods for solving
nonlinear simultaneous equations*, 1965).

Displacements that follow one another are often alike. The first step for a change d of the
displacement therefore repeats a part of the last one, whose forces changed by G for D, and bends as
far as the last one did from that before it,

.. math:: s_0 = ρ G + B (r - ρ D) + \tfrac12 ρ (ρ + 1) c, \qquad ρ = \frac{d · D}{D · D} ∈ [-1, 1],

and the bend c becomes :math:`ρ^2 c` and what the search finds beyond :math:`s_0`. For equal changes
this is the parabola through the last three frames. Where it makes the residual larger, the step is
B r after all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.touch.body import Predict

Array = NDArray[np.float64]

TOLERANCE = 1e-4  # of frames: residual over the largest held displacement
SLOW = 0.5  # part of a residual within the tolerance of frames that ends any search, if it is left
MOST = 40  # predictions of one step
LARGER = 1.5  # of residuals that a full step may leave
SHORTER, SHORTEST = 1 / 3, 1e-2  # parts of a step
FEW, SMALL = 12, 1e-3  # components for which B is measured, by so small a part of a step
SMALLEST = 1 / 64  # part of the displacement that a step applies


class ForceSearch:
    """Broyden's method for the forces of a grip; it begins where it has ended before.

    Parameters
    ----------
    stiffness : array, (m, m)
        Of the held components at rest, in N/m.

    Attributes
    ----------
    predictions : int
        Number of predictions of the last search.
    """

    def __init__(self, stiffness: Array) -> None:
        self._at_rest, self.predictions = stiffness, 0
        self.begin_at_rest()

    def begin_at_rest(self) -> None:
        """Forget where the last search has ended."""
        self._stiffness, self._is_measured = self._at_rest, True
        self._forces = self._reached = np.zeros(len(self._at_rest))
        self._moved = self._change = self._bend = self._reached

    def forces_of(self, displacement: Array) -> Array:
        """B times a small displacement in m, (m,): what it takes, in N."""
        return np.asarray(self._stiffness @ displacement)

    def find(self, displaced: Predict, target: Array, tolerance: float) -> Array:
        """Find forces in N, (m,), under which `displaced` is the target in m, the last one asked.

        It ends once the largest residual, over the largest component, is within the tolerance.

        Raises
        ------
        WorkError
            If none are found, however small the steps.
        """
        self.predictions, step, share = 0, 1.0, 0.0
        begin = self._reached
        while share < 1.0:
            aim = min(1.0, share + step)
            if self._converges(displaced, begin + aim * (target - begin), tolerance):
                share, step = aim, 2 * step
                continue
            if self._measures(displaced, step * float(np.abs(target - begin).max())):
                continue
            step /= 2
            if step >= SMALLEST:
                continue
            if not begin.any():
                off = f"{share:.0%} of the displacement after {self.predictions} predictions"
                raise WorkError(f"no forces are found that hold the body so: they reach {off}")
            self.begin_at_rest()
            begin, step, share = self._reached, 1.0, 0.0
        return self._forces

    def _measures(self, displaced: Predict, length: float) -> bool:
        """Measure B where the search stands, by a small force at each of a few components, once.

        The forces would move the body at rest by a part of a length in m.
        """
        if len(self._forces) > FEW or self._is_measured or not length:
            return False
        small = SMALL * length * np.diag(self._at_rest)
        before = displaced(self._forces)
        moved = [displaced(self._forces + force) - before for force in np.diag(small)]
        self.predictions += 1 + len(moved)
        slopes = np.array(moved).T / small
        if not np.isfinite(slopes).all() or np.linalg.cond(slopes) > 1 / SMALL**2:
            return False
        self._stiffness, self._is_measured = inverse(slopes), True
        return True

    def _converges(self, displaced: Predict, target: Array, tolerance: float) -> bool:
        """Go to a target; the state stays as it is if that fails."""
        forces, stiffness = self._forces, self._stiffness
        residual = target - displaced(forces)
        self.predictions += 1
        size = max(np.abs(target).max(), np.abs(residual).max())
        last, left = self.predictions + MOST, np.abs(residual).max()
        further = target - self._reached
        ratio = part_of(further, self._moved)
        guess = ratio * self._change + stiffness @ (residual - ratio * self._moved)
        guess = guess + ratio * (ratio + 1) / 2 * self._bend
        change, is_guess = guess, ratio != 0
        while left > tolerance * size:
            if self.predictions >= last:
                return False
            part, allowed = 1.0, LARGER * np.linalg.norm(residual)
            while True:
                moved = part * change
                remains = target - displaced(forces + moved)
                self.predictions += 1
                stiffness = updated(stiffness, moved, residual - remains)
                if np.linalg.norm(remains) <= allowed:
                    break
                if is_guess:  # the last frames are no guide
                    change, is_guess = stiffness @ residual, False
                    continue
                part, allowed = SHORTER * part, np.linalg.norm(residual)
                if part < SHORTEST or self.predictions >= last:
                    return False
            before, left = left, np.abs(remains).max()
            forces, residual = forces + moved, remains
            if left <= TOLERANCE * size and left > SLOW * before:
                break
            change, is_guess = stiffness @ residual, False
        if further.any():
            found = forces + stiffness @ residual - self._forces
            self._moved, self._change = further, found
            self._bend = ratio**2 * self._bend + found - guess
        self._forces, self._stiffness, self._reached = forces, stiffness, target
        self._is_measured = False
        return True


def part_of(vector: Array, last: Array, most: float = 1.0) -> float:
    """How far a vector goes along the last one, over its length; −1 to some number."""
    length = float(np.vdot(last, last))
    return float(np.clip(np.vdot(vector, last) / length, -1.0, most)) if length else 0.0


def updated(stiffness: Array, change: Array, effect: Array) -> Array:
    """Broyden's update of an inverse: the same, but for the effect of a change of the forces."""
    response = stiffness @ effect
    slope = float(change @ response)
    if not np.isfinite(effect).all() or abs(slope) <= 1e-3 * float(change @ change):
        return stiffness
    return stiffness + np.outer(change - response, change @ stiffness) / slope


def inverse(matrix: Array) -> Array:
    """Inverse of a matrix."""
    return np.asarray(np.linalg.inv(matrix), np.float64)
