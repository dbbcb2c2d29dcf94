from __future__ import annotations

from pathlib import Path

import numpy as np

from surrogate.figures.error_figures import error_over_displacement, error_over_uncertainty
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.measures.error_metrics import measure
from tests.surrogate.figures.pictures import assert_is_picture, nodal_test

# Two samples of three nodes in the plane, in m; norms by the triple 3, 4, 5.
STD = np.array([[[0.0, 0.0], [3e-3, 4e-3], [6e-3, 8e-3]], [[0.0, 0.0], [5e-3, 0.0], [0.03, 0.04]]])
ERRORS = np.array([[[0.0, 0.0], [3e-3, 4e-3], [0.0, 0.02]], [[0.0, 0.0], [0.0, 5e-3], [0.0, 0.0]]])


def test_error_over_displacement(tmp_path: Path, dataset: Dataset) -> None:
    force, reference, predicted = nodal_test(dataset)
    measures = measure(force, predicted, reference, dataset.geometry.tip)
    figure = error_over_displacement(np.arange(12.0), np.arange(12.0) / 1e3, measures)
    assert_is_picture(figure, tmp_path)
    assert "[mm]" in figure.axes[0].get_ylabel()


def test_error_over_uncertainty(tmp_path: Path) -> None:
    figure = error_over_uncertainty(STD, ERRORS)
    assert_is_picture(figure, tmp_path)
    axes = figure.axes[0]
    assert "deviation" in axes.get_xlabel()
    assert "error" in axes.get_ylabel()
    assert "[mm]" in axes.get_xlabel()
    assert "[mm]" in axes.get_ylabel()


def test_error_over_uncertainty_counts_nodes() -> None:
    """Two nodes at (5, 5) mm, one at (10, 20) mm; those without σ or without error are left out."""
    axes = error_over_uncertainty(STD, ERRORS).axes[0]
    assert sorted(np.asarray(axes.collections[0].get_array())) == [1, 2]
    equal, double = axes.lines
    np.testing.assert_allclose(np.asarray(equal.get_xydata()), [[5, 5], [10, 10]])
    np.testing.assert_allclose(np.asarray(double.get_xydata()), [[5, 10], [10, 20]])
