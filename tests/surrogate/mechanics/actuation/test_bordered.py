"""Equilibria under actuators of a body with one unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.mechanics.actuation.bordered import Balanced, Residual, balanced, newton

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stiffening:
    """A spring that is soft at rest, x / (1 - x²) - 0.999 x, and cannot reach 1."""

    force: float
    least: float = 1e-12

    @property
    def signs(self) -> Array:
        return np.ones(0)

    def under(self, part: float) -> Stiffening:
        return replace(self, force=part * self.force)

    def residual(self, state: Array, amplitudes: Array) -> Residual | None:
        if abs(state[0]) >= 1:
            return None
        r = state / (1 - state**2) - 0.999 * state - self.force
        return Residual(r, np.zeros((0, 1)), np.zeros(0))

    def inverse_at(
        self, state: Array, amplitudes: Array, rough: bool = False
    ) -> Callable[[Array], Array]:
        k = (1 + state**2) / (1 - state**2) ** 2 - 0.999
        return lambda right: right / k


def test_a_dead_load_is_increased_from_rest() -> None:
    """Newton's method at the whole load leaves what is possible; in parts it leads there."""
    body, rest = Stiffening(2.0), Balanced(np.zeros(1), np.zeros(0))
    assert newton(body, (), 1.0, rest, 1e-9) is None
    found = balanced(body, (), rest).state
    assert found / (1 - found**2) - 0.999 * found == pytest.approx(2.0, rel=1e-8)
