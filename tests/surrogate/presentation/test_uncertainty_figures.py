from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from shared_schema.drawing.figure_style import save
from surrogate.data.dataset import Dataset
from surrogate.presentation import uncertainty_figures as figures
from surrogate.uncertainty.calibration import CalibrationMeasures, judge

# Two samples of three nodes in the plane, in m; norms by the triple 3, 4, 5.
STD = np.array([[[0.0, 0.0], [3e-3, 4e-3], [6e-3, 8e-3]], [[0.0, 0.0], [5e-3, 0.0], [0.03, 0.04]]])
ERRORS = np.array([[[0.0, 0.0], [3e-3, 4e-3], [0.0, 0.02]], [[0.0, 0.0], [0.0, 5e-3], [0.0, 0.0]]])


def judged(factor: float) -> CalibrationMeasures:
    """Of 400 normal errors, whose σ is too large by a factor."""
    errors = np.random.default_rng(0).normal(size=(50, 4, 2))
    std = np.full_like(errors, factor)
    return judge(0 * errors, std, errors, np.ones(4, dtype=bool))


def draw(name: str, dataset: Dataset) -> Figure:
    if name == "curve":
        return figures.calibration_curve({"a": judged(1.0), "b": judged(2.0)})
    if name == "against":
        return figures.error_against_uncertainty(STD, ERRORS)
    mean = dataset.geometry.grid.to_nodes(dataset.test.displacement.double().numpy())[0]
    return figures.uncertainty_field(dataset.geometry, mean, 0.1 * np.abs(mean))


@pytest.mark.parametrize("name", ["curve", "against", "field"])
def test_figure_is_a_picture(tmp_path: Path, dataset: Dataset, name: str) -> None:
    path = tmp_path / f"{name}.png"
    save(draw(name, dataset), path)
    assert path.read_bytes().startswith(b"\x89PNG\r\n")
    pixels = imread(path)
    assert min(pixels.shape[:2]) > 300
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 10


def test_axes_are_labelled_with_units(dataset: Dataset) -> None:
    assert draw("curve", dataset).axes[0].get_ylabel() == "observed coverage"
    against = draw("against", dataset).axes[0]
    assert "deviation" in against.get_xlabel()
    assert "error" in against.get_ylabel()
    assert "[mm]" in against.get_xlabel()
    assert "[mm]" in against.get_ylabel()
    assert "[mm]" in draw("field", dataset).axes[1].get_ylabel()


def test_calibration_curves() -> None:
    """The diagonal, and a curve for each name with its area in the legend."""
    right, wide = judged(1.0), judged(2.0)
    figure = figures.calibration_curve({"right": right, "wide": wide})
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


def test_error_against_uncertainty_counts_nodes() -> None:
    """Two nodes at (5, 5) mm, one at (10, 20) mm; those without σ or without error are left out."""
    axes = figures.error_against_uncertainty(STD, ERRORS).axes[0]
    assert sorted(np.asarray(axes.collections[0].get_array())) == [1, 2]
    equal, double = axes.lines
    np.testing.assert_allclose(np.asarray(equal.get_xydata()), [[5, 5], [10, 10]])
    np.testing.assert_allclose(np.asarray(double.get_xydata()), [[5, 10], [10, 20]])


def test_uncertainty_field_is_in_millimetres_on_the_mean_mesh(dataset: Dataset) -> None:
    """σ of (3, 4) mm everywhere is 5 mm in norm; the mesh is moved by 0.25 m along x."""
    x = dataset.geometry.coordinates
    std = np.broadcast_to([3e-3, 4e-3], x.shape)
    mean = np.broadcast_to([0.25, 0.0], x.shape)
    figure = figures.uncertainty_field(dataset.geometry, mean, std)
    field, mesh = figure.axes[0].collections
    np.testing.assert_allclose(np.asarray(field.get_array()), 5.0)
    corners = np.concatenate([path.vertices for path in mesh.get_paths()])
    np.testing.assert_allclose(corners.min(axis=0), (x + mean).min(axis=0))
    np.testing.assert_allclose(corners.max(axis=0), (x + mean).max(axis=0))
