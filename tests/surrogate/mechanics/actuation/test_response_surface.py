"""Polynomials from values and slopes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.actuation.response_surface import ResponseSurface, points_of

Array = NDArray[np.float64]
RNG = np.random.default_rng(3)


def test_slopes_determine_what_values_leave_open() -> None:
    """A cubic of 3 variables, 20 products, from 10 points: values alone give a lower degree."""
    x, at = RNG.uniform(-1, 1, (10, 3)), np.array([0.2, -0.7, 0.4])

    def cubic(p: Array) -> Array:
        return np.stack(
            [p[..., 0] ** 3 - p[..., 1] * p[..., 2], 1 + p[..., 0] * p[..., 2] ** 2], -1
        )

    def slopes(p: Array) -> Array:
        a, b, c = p.T
        zero = 0 * a
        of = [(3 * a**2, c**2), (-c, zero), (-b, 2 * a * c)]
        return np.array([np.stack(pair, -1) for pair in of]).transpose(1, 0, 2)

    surface = ResponseSurface.fit(x, cubic(x), slopes(x), highest=3)
    assert len(surface.coefficients) == 20
    np.testing.assert_allclose(surface.at(at), cubic(at), atol=1e-12)
    np.testing.assert_allclose(surface.slopes(at), slopes(at[None])[0], atol=1e-11)
    assert len(ResponseSurface.fit(x, cubic(x)).coefficients) == 4
    assert points_of(3, 3) == 40
