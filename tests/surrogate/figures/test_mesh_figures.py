from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surrogate.figures.field_figures import NODAL_ERROR
from surrogate.figures.mesh_figures import close_up, deformed_meshes, meshes_and_errors
from surrogate.learning.data.dataset import Dataset
from tests.surrogate.figures.pictures import assert_is_picture, nodal_test


def test_deformed_meshes(tmp_path: Path, dataset: Dataset) -> None:
    force, reference, predicted = nodal_test(dataset)
    figure = deformed_meshes(dataset.geometry, predicted[0], reference[0], force[0])
    assert_is_picture(figure, tmp_path)
    assert figure.axes[0].get_xlabel() == "x [m]"


def test_close_up_shows_what_is_near_the_load(dataset: Dataset) -> None:
    """0.3 m above and below the loaded node, 0.6 m to its sides."""
    force, reference, predicted = nodal_test(dataset)
    loaded = np.flatnonzero(force[0].any(axis=1))
    figure = close_up(dataset.geometry, predicted[0], reference[0], loaded, 0.3)
    ((x, y),) = (dataset.geometry.coordinates + reference[0])[loaded]
    assert figure.axes[0].get_xlim() == pytest.approx((x - 0.6, x + 0.6))
    assert figure.axes[0].get_ylim() == pytest.approx((y - 0.3, y + 0.3))


def test_meshes_and_errors_are_side_by_side(dataset: Dataset) -> None:
    force, reference, predicted = nodal_test(dataset)
    figure = meshes_and_errors(dataset.geometry, predicted[0], reference[0], force[0])
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["y [m]", "y [m]", f"{NODAL_ERROR} [mm]"]
