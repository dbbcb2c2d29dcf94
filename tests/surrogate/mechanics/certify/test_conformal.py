"""Coverage of a calibration is F(q) where F, the scores' distribution function, is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import beta, kstest

from surrogate.learning.probabilistic.calibration import Array
from surrogate.mechanics.certify.conformal import (
    ConformalCalibration,
    Kind,
    conformal_quantile,
    samples_needed,
)

ALL = np.ones(3, dtype=bool)


def cauchy_coverage(factor: Array) -> Array:
    """P(|x| ≤ q) of the Cauchy distribution, (2/π) arctan q."""
    result: Array = 2 / np.pi * np.arctan(factor)
    return result


@pytest.mark.parametrize(
    ("count", "level", "expected"),
    [
        (9, 0.9, 9.0),  # ⌈10 · 0.9⌉ = 9
        (9, 0.8, 8.0),
        (9, 0.85, 9.0),  # ⌈8.5⌉
        (9, 0.5, 5.0),  # the median
        (19, 0.95, 19.0),
        (99, 0.07, 7.0),  # 100 · 0.07 is 7.000000000000001 in floating point
        (1, 0.5, 1.0),
    ],
)
def test_quantile_by_hand(count: int, level: float, expected: float) -> None:
    """Scores 1, 2, ... in any order, and twice these."""
    scores = np.random.default_rng(0).permutation(np.arange(1.0, count + 1))
    found = conformal_quantile(np.stack([scores, 2 * scores], axis=1), level)
    assert found.tolist() == [expected, 2 * expected]


@pytest.mark.parametrize(
    ("level", "needed"), [(0.5, 1), (0.8, 4), (0.9, 9), (0.95, 19), (0.99, 99), (0.85, 6)]
)
def test_too_few_samples(level: float, needed: int) -> None:
    """α = 0.15: ⌈6 · 0.85⌉ = 6 is more than 5 scores, ⌈7 · 0.85⌉ = 6 is not more than 6."""
    assert samples_needed(level) == needed
    assert conformal_quantile(np.arange(float(needed)), level) == needed - 1
    with pytest.raises(ValueError, match=rf"^{needed - 1} calibration .* at least {needed} for"):
        conformal_quantile(np.arange(float(needed - 1)), level)


@pytest.mark.parametrize("level", [0.0, 1.0, -0.1, 90.0])
def test_level_is_a_probability(level: float) -> None:
    with pytest.raises(ValueError, match=f"level is {level}, expected a number between 0 and 1"):
        conformal_quantile(np.arange(100.0), level)


def test_factors_by_hand() -> None:
    """Four samples, two free nodes in the plane, level 0.8: the largest of four scores."""
    free = np.array([False, True, True])
    mean = np.full((4, 3, 2), 10.0)
    std = np.zeros((4, 3, 2))
    std[:, 1:] = 0.5
    error = np.zeros((4, 3, 2))
    error[:, 1, 0] = 0.1, -0.4, 0.2, 0.3
    error[:, 1, 1] = -1.0, 0.0, 0.0, 0.5
    error[:, 2, 0] = 0.25, 0.25, 0.25, 0.25
    marginal = ConformalCalibration.fit(0.8, "marginal", mean, std, mean + error, free)
    np.testing.assert_allclose(marginal.factor, [[0.0, 0.0], [0.8, 2.0], [0.5, 0.0]], rtol=1e-12)
    band = ConformalCalibration.fit(0.8, "simultaneous", mean, std, mean + error, free)
    np.testing.assert_allclose(band.factor, [[0, 0], [2, 2], [2, 2]], rtol=1e-12)
    # Level 0.5, ⌈5 · 0.5⌉ = 3: third of the samples' largest scores 2, 0.8, 0.5, 1
    band = ConformalCalibration.fit(0.5, "simultaneous", mean, std, mean + error, free)
    assert band.factor[1, 0] == pytest.approx(1.0)
    assert (band.level, band.kind) == (0.5, "simultaneous")


def test_interval() -> None:
    calibration = ConformalCalibration(0.9, "marginal", np.array([[0.0, 0.0], [2.0, 3.0]]))
    mean = np.array([[0.0, 0.0], [1.0, -1.0]])
    lower, upper = calibration.interval(mean, np.array([[0.0, 0.0], [0.5, 0.1]]))
    np.testing.assert_allclose(lower, [[0.0, 0.0], [0.0, -1.3]], rtol=1e-12)
    np.testing.assert_allclose(upper, [[0.0, 0.0], [2.0, -0.7]], rtol=1e-12)
    lower, upper = calibration.interval(np.stack([mean, mean]), 1.0)
    assert lower[1].tolist() == [[0, 0], [-1, -4]]
    assert upper[1].tolist() == [[0, 0], [3, 2]]


def test_deterministic_surrogate() -> None:
    """With σ = 1 factors are errors in m: the ninth and the fifth of 1, ..., 9 mm."""
    reference = np.arange(1.0, 10.0)[:, None, None] * np.array([1e-3, -2e-3])
    for level, millimetres in [(0.9, 9), (0.5, 5)]:
        found = ConformalCalibration.fit(
            level, "marginal", np.zeros((9, 1, 2)), 1.0, reference, np.array([True])
        )
        np.testing.assert_allclose(found.factor, millimetres * np.array([[1e-3, 2e-3]]), rtol=1e-12)


@pytest.mark.parametrize(
    ("n", "level", "k"), [(9, 0.9, 9), (24, 0.9, 23), (40, 0.5, 21), (99, 0.95, 95)]
)
def test_marginal_coverage_is_beta(n: int, level: float, k: int) -> None:
    """5000 components are as many calibrations; errors heavy-tailed, without a mean (Cauchy)."""
    random = np.random.default_rng(n)
    std = random.uniform(0.1, 10.0, size=(n, 2500, 2))
    error = std * random.standard_cauchy(size=std.shape)
    free = np.ones(2500, dtype=bool)
    found = ConformalCalibration.fit(level, "marginal", np.zeros_like(std), std, error, free)
    coverage = cauchy_coverage(found.factor).ravel()
    law = beta(k, n + 1 - k)
    assert law.mean() == pytest.approx(k / (n + 1))
    assert coverage.mean() == pytest.approx(k / (n + 1), abs=4 * law.std() / np.sqrt(5000))
    assert kstest(coverage, law.cdf).pvalue > 1e-3


def test_simultaneous_coverage_is_beta() -> None:
    """Largest of six independent Cauchy scores: F(q)⁶ covers the field; n = 24, k = 23."""
    random = np.random.default_rng(0)
    coverage = []
    for _ in range(2000):
        error = random.standard_cauchy(size=(24, 3, 2))
        found = ConformalCalibration.fit(
            0.9, "simultaneous", np.zeros_like(error), np.ones_like(error), error, ALL
        )
        coverage.append(cauchy_coverage(found.factor[0, 0]) ** 6)
    law = beta(23, 2)
    assert np.mean(coverage) == pytest.approx(0.92, abs=4 * law.std() / np.sqrt(2000))
    assert kstest(coverage, law.cdf).pvalue > 1e-3


@pytest.mark.parametrize("kind", ["marginal", "simultaneous"])
def test_splits_of_samples_with_dependent_components(kind: Kind) -> None:
    """One sample in 25 is left out: it is covered as often as it is not the largest or second.

    The components of a sample err by one common factor, and σ is wrong by another; so all are
    covered at once, by both kinds, exactly in the 23 of 25 splits that k / (n + 1) = 0.92 says.
    """
    random = np.random.default_rng(0)
    common = random.standard_t(2, size=(25, 1, 1))
    shape = random.uniform(0.5, 2.0, size=(3, 2))
    mean = random.normal(size=(25, 3, 2))
    reference, std = mean + common * shape, np.broadcast_to(7.0 * shape, mean.shape)
    covered = []
    for left_out in range(25):
        rest = np.arange(25) != left_out
        found = ConformalCalibration.fit(0.9, kind, mean[rest], std[rest], reference[rest], ALL)
        lower, upper = found.interval(mean[left_out], std[left_out])
        inside = (lower <= reference[left_out]) & (reference[left_out] <= upper)
        covered.append(inside)
    assert np.mean(covered, axis=0).tolist() == [[23 / 25] * 2] * 3
