"""Errors are quantiles of a standard normal, so that shares and means are known exactly."""

from __future__ import annotations

from math import atan, erf, log, pi, sqrt
from statistics import NormalDist

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import spearmanr

from surrogate.learning.probabilistic.calibration import (
    Array,
    calibration_curve,
    crps,
    half_width,
    measure_calibration,
    miscalibration_area,
    negative_log_likelihood,
    rank_correlation,
)

NORMAL = NormalDist()
FREE = np.array([False, True, True, True, True, True])


def normal_errors(samples: int) -> Array:
    """Standard normal's quantiles (i + 1/2) / N, shuffled: (samples, 6, 2), node 0 at 0."""
    count = samples * 5 * 2
    quantiles = np.array([NORMAL.inv_cdf((i + 0.5) / count) for i in range(count)])
    result = np.zeros((samples, 6, 2))
    result[:, 1:] = np.random.default_rng(0).permutation(quantiles).reshape(samples, 5, 2)
    return result


def test_negative_log_likelihood() -> None:
    found = negative_log_likelihood(np.array([0.0, 2.0, -6.0]), np.full(3, 2.0))
    at_mean = 0.5 * log(2 * pi * 4)  # and z²/2 more
    np.testing.assert_allclose(found, [at_mean, at_mean + 0.5, at_mean + 4.5], rtol=1e-14)


def test_crps_at_the_mean() -> None:
    """σ (√2 − 1) / √π = 0.2337 σ."""
    found = crps(np.zeros(2), np.array([1.0, 0.3]))
    np.testing.assert_allclose(found, [0.23369498, 0.3 * 0.23369498], rtol=1e-7)


@pytest.mark.parametrize(("error", "std"), [(0.0, 1.0), (0.7, 0.4), (-3.0, 2.0), (5.0, 0.5)])
def test_crps_against_its_integral(error: float, std: float) -> None:
    below = quad(lambda x: NORMAL.cdf(x / std) ** 2, -12 * std, error)[0]
    above = quad(lambda x: (1 - NORMAL.cdf(x / std)) ** 2, error, max(error, 0) + 12 * std)[0]
    found = crps(np.array([error]), np.array([std]))
    assert found[0] == pytest.approx(below + above, rel=1e-7)


def test_half_width() -> None:
    """Values from a table of the normal distribution."""
    found = [half_width(level) for level in (0.5, 0.9, 0.95)]
    np.testing.assert_allclose(found, [0.674490, 1.644854, 1.959964], atol=5e-7)


@pytest.mark.parametrize("factor", [0.25, 0.5, 1.0, 2.0])
def test_curve_and_area_of_a_wrong_std(factor: float) -> None:
    """With σ wrong by c, erf(c z_p / √2) is covered, and the area is |(2/π) arctan c − 1/2|.

    The area under the curve is the chance of |X| ≤ c|Y| for independent standard normals.
    """
    error = normal_errors(samples=2000)[:, 1:]
    levels, observed = calibration_curve(error, np.full_like(error, factor))
    expected = [erf(factor * NORMAL.inv_cdf((1 + p) / 2) / sqrt(2)) for p in levels[:-1]]
    np.testing.assert_allclose(observed[:-1], expected, atol=1e-4)
    assert (observed[0], observed[-1], len(levels)) == (0.0, 1.0, 101)
    closed_form = abs(2 / pi * atan(factor) - 0.5)
    integral, _ = quad(lambda p: abs(erf(factor * NORMAL.inv_cdf((1 + p) / 2) / sqrt(2)) - p), 0, 1)
    assert integral == pytest.approx(closed_form, abs=1e-6)
    assert miscalibration_area(levels, observed) == pytest.approx(closed_form, abs=2.5e-3)


def test_area_by_hand() -> None:
    """Gaps of 0, 0.25 and 0 at 0, 0.5 and 1: a triangle of area 0.125."""
    found = miscalibration_area(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.25, 1.0]))
    assert found == pytest.approx(0.125)


def test_rank_correlation_against_scipy() -> None:
    x, y = np.random.default_rng(0).integers(0, 8, size=(2, 3, 30)).astype(float)
    expected = [spearmanr(a, b).statistic for a, b in zip(x, y, strict=True)]
    np.testing.assert_allclose(rank_correlation(x, y), expected, rtol=1e-12)


def test_measures_of_a_right_std() -> None:
    """σ = 0.2 m and errors of 0.2 times a standard normal: a perfect forecast."""
    error = 0.2 * normal_errors(samples=1000)
    mean = np.random.default_rng(1).normal(size=error.shape)
    std = np.where(FREE[:, None], 0.2, 0.0) * np.ones_like(error)
    found = measure_calibration(mean, std, mean + error, FREE)
    assert found.samples == 1000
    assert found.mean_std == pytest.approx(0.2)
    assert [interval.level for interval in found.intervals] == [0.5, 0.9, 0.95]
    coverage = [interval.coverage for interval in found.intervals]
    np.testing.assert_allclose(coverage, [0.5, 0.9, 0.95], atol=1e-4 + 1e-9)  # 10⁴ components
    width = [interval.width for interval in found.intervals]
    np.testing.assert_allclose(width, 0.4 * np.array([0.674490, 1.644854, 1.959964]), rtol=1e-6)
    entropy = 0.5 * log(2 * pi * 0.04) + 0.5
    assert found.negative_log_likelihood == pytest.approx(entropy, abs=5e-4)
    assert found.crps == pytest.approx(0.2 / sqrt(pi), rel=1e-3)  # E|X − X'| / 2
    assert found.miscalibration_area == pytest.approx(0.0, abs=1e-4)
    assert (found.node_rank_correlation, found.sample_rank_correlation) == (0.0, 0.0)  # σ constant


def test_measures_of_a_doubled_std() -> None:
    error = normal_errors(samples=1000)
    std = np.where(FREE[:, None], 2.0, 0.0) * np.ones_like(error)
    found = measure_calibration(np.zeros_like(error), std, error, FREE)
    expected = [erf(2 * z / sqrt(2)) for z in (0.674490, 1.644854, 1.959964)]
    np.testing.assert_allclose(
        [interval.coverage for interval in found.intervals], expected, atol=1e-4
    )
    # ½ ln(2π · 4) + ½ / 4, the mean of z² being 1/4
    assert found.negative_log_likelihood == pytest.approx(0.5 * log(8 * pi) + 0.125, abs=5e-4)


def test_rank_correlations_of_samples() -> None:
    """Node errors 1, 3, 2 and 2, 6, 4 over nodal σ of the same order and of the reverse one."""
    free = np.array([True, True, True, False])
    reference = np.zeros((2, 4, 2))
    reference[0, :3, 0] = 1.0, 3.0, 2.0
    reference[1, :3, 0] = 2.0, 6.0, 4.0
    std = np.zeros((2, 4, 2))
    std[0, :3] = np.array([0.1, 0.7, 0.2])[:, None]
    std[1, :3] = np.array([0.3, 0.1, 0.2])[:, None]
    found = measure_calibration(np.zeros_like(std), std, reference, free)
    assert found.node_rank_correlation == pytest.approx(0.0)  # mean of 1 and −1
    assert found.sample_rank_correlation == pytest.approx(-1.0)  # e_m rises, mean σ falls
    std[1, :3] *= 10
    assert (
        measure_calibration(np.zeros_like(std), std, reference, free).sample_rank_correlation == 1.0
    )
