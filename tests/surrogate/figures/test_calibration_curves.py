from __future__ import annotations

from pathlib import Path

import numpy as np

from surrogate.figures.curves import calibration_curves
from surrogate.learning.probabilistic.calibration import CalibrationMeasures, measure_calibration
from tests.surrogate.figures.pictures import assert_is_picture


def judged(factor: float) -> CalibrationMeasures:
    """Measures of 400 standard normal errors whose predicted σ is `factor` instead of 1."""
    errors = np.random.default_rng(0).normal(size=(50, 4, 2))
    std = np.full_like(errors, factor)
    return measure_calibration(0 * errors, std, errors, np.ones(4, dtype=bool))


def test_calibration_curves(tmp_path: Path) -> None:
    """The diagonal, and a curve for each name with its area in the legend."""
    right, wide = judged(1.0), judged(2.0)
    figure = calibration_curves({"right": right, "wide": wide})
    assert_is_picture(figure, tmp_path)
    assert figure.axes[0].get_ylabel() == "observed coverage"
    diagonal, *curves = figure.axes[0].lines
    assert (diagonal.get_linestyle(), diagonal.get_color()) == ("--", "0.4")
    np.testing.assert_array_equal(diagonal.get_xydata(), [[0, 0], [1, 1]])
    for curve, measures in zip(curves, (right, wide), strict=True):
        expected = np.stack([measures.levels, measures.observed], axis=1)
        np.testing.assert_array_equal(curve.get_xydata(), expected)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        f"right, area {right.miscalibration_area:.3f}",
        f"wide, area {wide.miscalibration_area:.3f}",
    ]
    assert len({str(curve.get_color()) for curve in curves}) == 2
