from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from shared_schema.drawing.figure_style import save
from surrogate.data.dataset import Dataset
from surrogate.evaluation.metrics import measure
from surrogate.presentation import figures

LINES = [
    {"epoch": 1, "train_loss": 1.0, "validation_loss": 1.1},
    {"epoch": 2, "train_loss": 0.1, "validation_loss": 0.2},
]


def nodal(dataset: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces, reference displacements and made-up predictions of the test split."""
    grid = dataset.geometry.grid
    force = grid.to_nodes(dataset.test.force.double().numpy())
    reference = grid.to_nodes(dataset.test.displacement.double().numpy())
    return force, reference, 0.9 * reference


def draw(name: str, dataset: Dataset) -> Figure:
    force, reference, predicted = nodal(dataset)
    measures = measure(force, predicted, reference, dataset.geometry.tip)
    if name == "deformed":
        return figures.deformed_meshes(dataset.geometry, predicted[0], reference[0], force[0])
    if name == "error_field":
        return figures.error_field(dataset.geometry, predicted[0], reference[0])
    if name == "errors":
        return figures.sorted_errors(np.arange(12.0), np.arange(12.0) / 1e3, measures)
    return figures.loss_curves({"mean absolute error": LINES})


@pytest.mark.parametrize("name", ["deformed", "error_field", "errors", "loss"])
def test_figure_is_a_picture(tmp_path: Path, dataset: Dataset, name: str) -> None:
    path = tmp_path / f"{name}.png"
    save(draw(name, dataset), path)
    assert path.read_bytes().startswith(b"\x89PNG\r\n")
    pixels = imread(path)
    assert min(pixels.shape[:2]) > 300
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 10


def test_axes_are_labelled_with_units(dataset: Dataset) -> None:
    assert draw("deformed", dataset).axes[0].get_xlabel() == "x [m]"
    assert "[mm]" in draw("error_field", dataset).axes[1].get_ylabel()
    assert "[mm]" in draw("errors", dataset).axes[0].get_ylabel()
    (axes,) = draw("loss", dataset).axes
    assert (axes.get_title(), axes.get_ylabel()) == ("mean absolute error", "loss, scaled")


def test_losses_share_the_ordinate() -> None:
    """One of the two runs has no validation part; the smallest loss is 0.1, or below 0."""
    lines = [{"epoch": 1, "train_loss": 1.0}, {"epoch": 2, "train_loss": 0.5}]
    left, right = figures.loss_curves({"a": lines, "b": LINES}).axes
    assert (len(left.lines), len(right.lines)) == (1, 2)
    assert left.get_ylim() == right.get_ylim()
    assert (left.get_yscale(), right.get_yscale()) == ("log", "log")
    negative = [*lines, {"epoch": 3, "train_loss": -0.5}]
    left, right = figures.loss_curves({"a": negative, "b": LINES}).axes
    assert (left.get_yscale(), right.get_yscale()) == ("linear", "linear")


def test_close_up_shows_what_is_near_the_load(dataset: Dataset) -> None:
    """0.3 m above and below the loaded node, 0.6 m to its sides."""
    force, reference, predicted = nodal(dataset)
    loaded = np.flatnonzero(force[0].any(axis=1))
    figure = figures.close_up(dataset.geometry, predicted[0], reference[0], loaded, 0.3)
    ((x, y),) = (dataset.geometry.coordinates + reference[0])[loaded]
    assert figure.axes[0].get_xlim() == pytest.approx((x - 0.6, x + 0.6))
    assert figure.axes[0].get_ylim() == pytest.approx((y - 0.3, y + 0.3))


def test_meshes_and_errors_are_side_by_side(dataset: Dataset) -> None:
    force, reference, predicted = nodal(dataset)
    figure = figures.meshes_and_errors(dataset.geometry, predicted[0], reference[0], force[0])
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["y [m]", "y [m]", figures.NODAL_ERROR]
