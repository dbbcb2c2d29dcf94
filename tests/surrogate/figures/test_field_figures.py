from __future__ import annotations

from pathlib import Path

import numpy as np

from shared_schema.common.drawing.mesh_drawing import deformed_figure
from surrogate.figures.error_figures import error_over_displacement, error_over_uncertainty
from surrogate.figures.field_figures import error_beside_certificate, error_field, uncertainty_field
from surrogate.figures.stress_figures import von_mises_beside_reference
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.measures.error_metrics import measure
from surrogate.mechanics.body.elements_of_case import with_elements
from tests.surrogate.figures.pictures import assert_is_picture, nodal_test


def test_error_field(tmp_path: Path, dataset: Dataset) -> None:
    _, reference, predicted = nodal_test(dataset)
    figure = error_field(dataset.geometry, predicted[0], reference[0])
    assert_is_picture(figure, tmp_path)
    assert "[mm]" in figure.axes[1].get_ylabel()


def test_uncertainty_field(tmp_path: Path, dataset: Dataset) -> None:
    _, reference, _ = nodal_test(dataset)
    figure = uncertainty_field(dataset.geometry, reference[0], 0.1 * np.abs(reference[0]))
    assert_is_picture(figure, tmp_path)
    assert "[mm]" in figure.axes[1].get_ylabel()


def test_uncertainty_field_is_in_millimetres_on_the_mean_mesh(dataset: Dataset) -> None:
    """σ of (3, 4) mm everywhere is 5 mm in norm; the mesh is moved by 0.25 m along x."""
    x = dataset.geometry.coordinates
    std = np.broadcast_to([3e-3, 4e-3], x.shape)
    mean = np.broadcast_to([0.25, 0.0], x.shape)
    figure = uncertainty_field(dataset.geometry, mean, std)
    field, mesh = figure.axes[0].collections
    np.testing.assert_allclose(np.asarray(field.get_array()), 5.0)
    corners = np.concatenate([path.vertices for path in mesh.get_paths()])
    np.testing.assert_allclose(corners.min(axis=0), (x + mean).min(axis=0))
    np.testing.assert_allclose(corners.max(axis=0), (x + mean).max(axis=0))


def test_error_beside_certificate_in_one_unit(dataset: Dataset) -> None:
    """A displacement of 50 mm, its error of (3, 4) mm, and an estimate of (6, 8) mm."""
    x = dataset.geometry.coordinates
    predicted, error, estimated = (
        np.broadcast_to(each, x.shape) for each in ([0.03, 0.04], [3e-3, 4e-3], [6e-3, 8e-3])
    )
    figure = error_beside_certificate(dataset.geometry, predicted, predicted - error, estimated)
    fields = [axes for axes in figure.axes if axes.get_ylabel().endswith("[mm]")]
    drawn = [axes.collections[0].get_array() for axes in figure.axes if axes.get_xlabel()]
    assert len(fields) == 3
    for values, expected in zip(drawn, (50, 5, 10), strict=True):
        np.testing.assert_allclose(np.asarray(values), expected)


def test_figures_name_the_units_of_the_case(dataset: Dataset) -> None:
    """A body in mm, moved by σ of 5e-4 mm: its axes are in mm, the field in µm: 0.5."""
    geometry = with_elements(dataset.geometry, {"units": {"length": "mm", "force": "kN"}}, None)
    x = geometry.coordinates
    std = np.broadcast_to([3e-4, 4e-4], x.shape)
    figure = uncertainty_field(geometry, 0 * x, std)
    assert figure.axes[0].get_xlabel() == "x [mm]"
    assert figure.axes[1].get_ylabel().endswith("[µm]")
    np.testing.assert_allclose(np.asarray(figure.axes[0].collections[0].get_array()), 0.5)
    force = np.zeros_like(x)
    force[-1, 1] = 2.0
    axes = deformed_figure(geometry, 0 * x, force).axes
    assert "2 kN" in [text.get_text() for text in axes[0].texts]
    assert axes[1].get_ylabel() == r"displacement $\|u\|_2$ [mm]"
    mises = np.ones(len(geometry.cells))
    stresses = von_mises_beside_reference(geometry, 0 * x, 0 * x, (mises, mises))
    assert stresses.axes[2].get_ylabel().endswith("[GPa]")


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
