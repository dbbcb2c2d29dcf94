"""Two nodes in the plane, three samples; every number below is found by hand."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.learning.measures.error_metrics import (
    displacement_at_load,
    measure,
    node_errors,
    regression_line,
    sample_errors,
)

# Node 1 is the tip; it moves by 5, 10 and 13 (Pythagorean triples).
REFERENCE = np.array(
    [
        [[0.0, 0.0], [3.0, 4.0]],
        [[0.0, 0.0], [6.0, 8.0]],
        [[0.0, 0.0], [5.0, 12.0]],
    ]
)
ERROR = np.array(
    [
        [[0.0, 0.0], [0.3, -0.4]],  # sum of magnitudes 0.7, over 4 components 0.175; tip 0.5 / 5
        [[0.2, 0.0], [0.0, 0.1]],  # 0.3 / 4 = 0.075; tip 0.1 / 10
        [[0.0, 0.0], [-0.6, 0.8]],  # 1.4 / 4 = 0.35; tip 1 / 13
    ]
)
FORCE = np.zeros_like(REFERENCE)
FORCE[:, 1, 1] = 1.0


def test_sample_errors() -> None:
    found = sample_errors(REFERENCE + ERROR, REFERENCE)
    np.testing.assert_allclose(found, [0.175, 0.075, 0.35], rtol=1e-12)


def test_node_errors() -> None:
    found = node_errors(REFERENCE + ERROR, REFERENCE)
    np.testing.assert_allclose(found, [[0, 0.5], [0.2, 0.1], [0, 1.0]], rtol=1e-12)


def test_displacement_at_load() -> None:
    np.testing.assert_allclose(displacement_at_load(FORCE, REFERENCE), [5, 10, 13], rtol=1e-12)


def test_displacement_at_several_loads_is_the_largest() -> None:
    """Nodes move by 1, 5 and 13; the last is not loaded in the first sample."""
    displacement = np.array([[[1.0, 0.0], [3.0, 4.0], [5.0, 12.0]]] * 3)
    force = np.zeros_like(displacement)
    force[0, :2, 0] = 1.0
    force[1, [0, 2], 1] = -1.0
    assert displacement_at_load(force, displacement).tolist() == [5.0, 13.0, 0.0]


def test_measure() -> None:
    found = measure(FORCE, REFERENCE + ERROR, REFERENCE, tip=1)
    assert found.samples == 3
    assert found.mean_error == pytest.approx(0.2)  # (0.175 + 0.075 + 0.35) / 3
    # deviations -0.025, -0.125, 0.15: squares 0.000625 + 0.015625 + 0.0225 = 0.03875, over 3 - 1
    assert found.std_error == pytest.approx(0.019375**0.5)
    assert found.max_error == pytest.approx(0.8)
    # relative errors at the tip: 0.1, 0.01, 1 / 13
    assert found.relative_tip_error_median == pytest.approx(1 / 13)
    assert found.relative_tip_error_mean == pytest.approx((0.1 + 0.01 + 1 / 13) / 3)
    # largest displacements 5, 10, 13; largest nodal errors 0.5, 0.2, 1
    assert found.relative_error_mean == pytest.approx((0.175 / 5 + 0.075 / 10 + 0.35 / 13) / 3)
    assert found.relative_node_error_median == pytest.approx(1 / 13)
    # Line of e over x = 5, 10, 13 (mean 28/3): Σ(x - x̄)² = 98/3,
    # Σ(x - x̄)(e - ē) = 5·(-0.025) + 10·(-0.125) + 13·0.15 = 0.575
    assert found.slope == pytest.approx(0.575 * 3 / 98)
    assert found.intercept == pytest.approx(0.2 - 0.575 * 3 / 98 * 28 / 3)
    assert found.plain()["mean_error"] == found.mean_error
    assert len(found.plain()) == 10


def test_one_sample_has_no_deviation() -> None:
    found = measure(FORCE[:1], (REFERENCE + ERROR)[:1], REFERENCE[:1], tip=1)
    assert (found.std_error, found.slope) == (0.0, 0.0)
    assert found.intercept == found.mean_error == pytest.approx(0.175)


def test_samples_whose_tip_rests_have_no_relative_error() -> None:
    reference = REFERENCE.copy()
    reference[1, 1] = 0.0
    found = measure(FORCE, reference + ERROR, reference, tip=1)
    assert found.relative_tip_error_mean == pytest.approx((0.1 + 1 / 13) / 2)


def test_regression_line() -> None:
    x = np.array([0.0, 1.0, 2.0, 5.0])
    assert regression_line(x, 0.5 - 2.0 * x) == pytest.approx((-2.0, 0.5))
    assert regression_line(np.ones(3), np.array([1.0, 2.0, 6.0])) == (0.0, 3.0)
