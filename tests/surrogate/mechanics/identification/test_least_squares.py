"""Robust fits: their distribution, a curved valley, and fits that go on from others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from surrogate.mechanics.identification.least_squares import Model, fit, refit

Array = NDArray[np.float64]


def test_linear_fits_have_the_distribution_of_student() -> None:
    """Estimates over their standard deviations, of 300 linear problems with normal noise."""
    rng = np.random.default_rng(0)
    matrix, theta, scores = rng.normal(size=(8, 2, 3)), np.array([1.0, -2.0, 0.5]), []
    model = Model(lambda at: matrix @ at, lambda at, state: matrix, lambda state: state)
    for _ in range(300):
        measured = matrix @ theta + rng.normal(0, 0.1, (8, 2))
        found = fit(model, measured, np.zeros(3), np.ones(3), None)
        assert found.freedom == 2 * found.counts.sum() - 3
        scores.append((found.theta - theta) / np.sqrt(np.diag(found.covariance)))
    inside = np.mean(np.abs(scores) < t.ppf(0.95, 13))
    assert 0.86 < inside < 0.93  # 0.9; markers that are left out at random make it a little less


def test_a_curved_valley_is_followed() -> None:
    """Rosenbrock's function (1960, *The Computer Journal* 3), in rows that all tell the same."""

    def state(at: Array) -> Array:
        x, y = at
        return np.tile([10 * (y - x**2), x], (4, 1))

    def slopes(at: Array, _: Array) -> Array:
        return np.tile([[-20 * at[0], 10.0], [1.0, 0.0]], (4, 1, 1))

    model = Model(state, slopes, lambda seen: seen)
    found = fit(model, np.tile([0.0, 1.0], (4, 1)), np.array([-1.2, 1.0]), np.ones(2), 1e-3)
    np.testing.assert_allclose(found.theta, [1, 1], atol=1e-3)


def test_fits_go_on_from_those_of_a_model_that_is_close() -> None:
    """Wild rows, σ and parameters are those of a fit from the beginning."""
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(20, 2, 2))

    def model(bend: float) -> Model:
        return Model(
            lambda at: matrix @ (at + bend * at**2),
            lambda at, state: matrix * (1 + 2 * bend * at),
            lambda state: state,
        )

    measured = model(0.12).state(np.array([1.0, -0.5])) + rng.normal(0, 0.01, (20, 2))
    measured[4] += 1
    first = fit(model(0.1), measured, np.zeros(2), np.ones(2), None)
    near = model(0.12)
    found = refit(near, measured, first, near.state(first.theta), np.ones(2), None)
    afresh = fit(near, measured, np.zeros(2), np.ones(2), None)
    assert not found.counts[4]
    np.testing.assert_array_equal(found.counts, afresh.counts)
    std = np.sqrt(np.diag(afresh.covariance))
    np.testing.assert_array_less(np.abs(found.theta - afresh.theta), 0.05 * std)
    np.testing.assert_array_less(np.abs(found.theta - [1, -0.5]), 4 * std)
    assert np.all(np.abs(first.theta - afresh.theta) > std)  # the other model is another one
    np.testing.assert_allclose(found.sigma, afresh.sigma, rtol=1e-3)
