"""Steps along directions, where forces rise steeply and where they would grow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.mechanics.descent.directions import Directions
from surrogate.mechanics.descent.driven_body import DrivenBody

Array = NDArray[np.float64]


@dataclass(frozen=True)
class At:
    """A displacement of two springs, (1, 2), and the forces on it."""

    u: Array
    r: Array


class Springs:
    """One that stiffens exponentially, as fibres do: sinh(a x); one that is linear: k y."""

    def __init__(self, stiffening: float, linear: float) -> None:
        self.stiffening, self.linear = stiffening, linear

    def state(self, u: Array, force: Array) -> At:
        """Forces out of balance."""
        x, y = u[0]
        return At(u, np.array([[np.sinh(self.stiffening * x), self.linear * y]]) - force)


def step(springs: Springs, force: Array, d: Array) -> At:
    """Step from rest."""
    directions = Directions(cast(DrivenBody, springs), force)
    found = directions.step(springs.state(np.zeros((1, 2)), force), d)  # type: ignore[arg-type]
    return cast(At, found)


@pytest.mark.parametrize("stiffening", [10.0, 40.0, 80.0])
def test_a_step_is_not_shortened_to_nothing(stiffening: float) -> None:
    """sinh(a x) = 1 at x = asinh(1)/a = 0.09, 0.022 and 0.011, for a direction of length 1.

    The secant through 0 and 1 alone would leave 1/sinh(a) of the direction, 1e-17 for a = 40.
    """
    force = np.array([[1.0, 0.0]])
    found = step(Springs(stiffening, 1.0), force, np.array([[1.0, 0.0]]))
    equilibrium = np.arcsinh(1) / stiffening
    assert 0.3 * equilibrium < found.u[0, 0] < 2 * equilibrium


def test_a_step_does_not_leave_far_larger_forces() -> None:
    """The whole direction turns no force round along it, but leaves 10 N across where 1 N was.

    Its half leaves (−1, 5) N, above five times the force at rest, and its quarter (−1, 2.5) N.
    """
    force = np.array([[1.0, 0.0]])
    found = step(Springs(1e-3, 100.0), force, np.array([[1.0, 0.1]]))
    assert np.linalg.norm(found.r) <= 5
    assert found.u[0, 0] == 0.25
