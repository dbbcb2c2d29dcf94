r"""Unknown forces under which predictions fulfil a condition: places held, or a tool touched.

Around a prediction the body is taken for linear, :math:`u ≈ u_k + C (f - f_k)`
(`surrogate.mechanics.touch.loaded_body`). A prediction with the forces that the condition asks of
this linear body is the next :math:`u_k`, and tells what C lacks; it is the last one if the
condition is fulfilled. Where a step makes it worse, a part of it is taken; where that does not
help, the condition is approached in steps, which are halved where they fail.

Frames that follow one another are often alike. Where the condition moves by a part ρ of its last
move, in which forces changed by S and displacements by Y, the body does so too, and bends as far
as it did: it moves by

.. math:: δu = C \, δf + ρ (Y - C S) + \tfrac12 ρ (ρ + 1) c, \qquad ρ \in [-1, 1].

The bend c becomes :math:`ρ^2 c` and what the first prediction shows beyond that. For equal moves
this is the parabola through the last three frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.mechanics.equilibrium.halved_steps import halved_steps
from surrogate.mechanics.touch.condition import Condition
from surrogate.mechanics.touch.loaded_body import LinearBody

Array = NDArray[np.float64]

MOST = 30  # predictions of one step
LARGER = 2.0  # how much more a full step may leave
SHORTEST = 1 / 8  # part of a step
SLOW, ENOUGH = 0.5, 1e-4  # part that is left of what is enough for any search, which then ends it


@dataclass(frozen=True)
class Shown:
    """What is predicted, or found, with forces.

    Attributes
    ----------
    field : array, (n_nodes, d)
        Displacement in m.
    u, force : array, (m,)
        Displacement in m of the components that bear the forces, and these in N.
    """

    field: Array
    u: Array
    force: Array


class Bend:
    """What moves of a condition have done beyond the linear response of the components, (m,)."""

    def __init__(self, body: LinearBody) -> None:
        self._body, nothing = body, body.at_rest
        self._moved = self._change = self._effect = self._bend = nothing
        self._next, self._ratio, self._expected = nothing, 0.0, nothing

    def expected(self, moved: Array) -> Array:
        """Displacement in m beyond the linear one as the condition moves so, (m,)."""
        ratio = part_of(moved, self._moved)
        lack = self._effect - self._body.moved(self._change)
        self._next, self._ratio = moved, ratio
        self._expected = ratio * lack + ratio * (ratio + 1) / 2 * self._bend
        return np.asarray(self._expected)

    def learn(self, lack: Array, change: Array, effect: Array) -> None:
        """Learn from a frame.

        Parameters
        ----------
        lack : array, (m,)
            Displacement in m by its first prediction, beyond the linear one.
        change, effect : array, (m,)
            How forces in N and displacements in m have changed.
        """
        self._bend = self._ratio**2 * self._bend + lack - self._expected
        self._moved, self._change, self._effect = self._next, change, effect


class ForceSearch:
    """A search for forces, from those of a body at rest or of the last frame.

    Parameters
    ----------
    body : LinearBody
    predicted : callable
        Forces on the components in N, (m,), to what is predicted.
    shown : Shown
        Where it begins.

    Attributes
    ----------
    shown : Shown
        Where it stands.
    predictions : int
    expected : array, (m,), or number
        Displacement in m that is expected of the first step, beyond the linear one.
    lack : array, (m,), or None
        What it was, if the search has begun with a step.
    """

    def __init__(self, body: LinearBody, predicted: Callable[[Array], Shown], shown: Shown) -> None:
        self._body, self._predicted, self.shown = body, predicted, shown
        self.predictions = 0
        self.expected: Array | float = 0.0
        self.lack: Array | None = None

    def predict(self, force: Array) -> None:
        """Predict what forces do."""
        self.shown, self.predictions = self._predicted(force), self.predictions + 1

    def find(self, condition: Condition, tolerance: float) -> None:
        """Find the forces, to a tolerance over the size of the condition.

        Raises
        ------
        WorkError
            If none are found, however small the steps.
        """
        begin = self.shown.u

        def go(share: float, last: Shown) -> Shown:
            self.shown = last
            if not self._converges(condition.on_the_way(share, begin), tolerance):
                raise WorkError(f"{self.predictions} predictions")
            return self.shown

        halved_steps(go, self.shown, "no forces are found beyond {:.0%} of the way")

    def _converges(self, condition: Condition, tolerance: float) -> bool:
        """Whether steps lead to the condition."""
        body, last, left, first = self._body, self.predictions + MOST, np.inf, None
        while True:
            begin = self.shown
            before, left = left, condition.wrong(begin.u, begin.force)
            first = left if first is None else first
            size = condition.size(begin.field, first)
            if left <= tolerance * size or SLOW * before < left <= ENOUGH * size:
                return True
            expected = 0.0 if self.predictions else self.expected
            wanted = condition.forces(body, begin.u + expected, begin.force)
            if wanted is None or self.predictions >= last:
                return False
            part = 1.0
            while True:
                self.predict(begin.force + part * (wanted - begin.force))
                if not np.isfinite(self.shown.field).all():
                    return False
                now = self.shown
                lack = body.learn(now.force - begin.force, now.u - begin.u)
                if self.predictions == 1:
                    self.lack = lack
                if before == np.inf or condition.wrong(now.u, now.force) <= LARGER * left:
                    break
                part /= 2
                if part < SHORTEST or self.predictions >= last:
                    return False


def part_of(vector: Array, last: Array, most: float = 1.0) -> float:
    """How far a vector goes along the last one, over its length; −1 to some number."""
    length = float(np.vdot(last, last))
    return float(np.clip(np.vdot(vector, last) / length, -1.0, most)) if length else 0.0
