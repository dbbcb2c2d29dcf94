"""Robust fits: their distribution, a curved valley, and fits that go on from others."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import t

from surrogate.mechanics.identification.least_squares import Model, fit, refit
from surrogate.mechanics.identification.markers import noise_probability, order_probability

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


def test_size() -> None:
    """χ² of 10 numbers, less 2: 26.12 has the probability 0.001 (tables); twice for two tests."""
    x, left = np.zeros((5, 2)), np.full((5, 2), 3.0 * np.sqrt(2.612))
    assert noise_probability(x, left, 2, 3.0) == pytest.approx(0.002, rel=0.01)
    assert noise_probability(x, left, 2, None) == 1.0  # five markers tell no order


def test_noise_is_called_so() -> None:
    """Of 200 kinds of noise, 1 % are below 0.01, 5 % below 0.05 (within three deviations)."""
    found = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found.append(order_probability(rng.random((20, 2)), rng.normal(size=(20, 2))))
    assert np.mean(np.array(found) < 0.01) < 0.04
    assert 0.01 < np.mean(np.array(found) < 0.05) < 0.1
    assert 0.35 < np.mean(np.array(found) < 0.5) < 0.65


def test_order_is_no_noise() -> None:
    """A wave over the body of the size of the noise."""
    rng = np.random.default_rng(0)
    x = rng.random((30, 2))
    left = np.sin(4 * x[:, :1]) * np.array([1.0, -1.0]) + 0.5 * rng.normal(size=(30, 2))
    left -= left.mean(axis=0)
    assert noise_probability(x, left, 2, None) < 0.005
