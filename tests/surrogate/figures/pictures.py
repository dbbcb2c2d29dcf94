"""Check of drawn figures, and test samples to draw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread

from shared_schema.common.drawing.figure_style import save
from surrogate.learning.data.dataset import Dataset


def assert_is_picture(figure: Figure, folder: Path) -> None:
    """A figure, saved, is a PNG of more than 300 pixels a side and more than 10 colours."""
    path = folder / "figure.png"
    save(figure, path)
    assert path.read_bytes().startswith(b"\x89PNG\r\n")
    pixels = imread(path)
    assert min(pixels.shape[:2]) > 300
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 10


def nodal_test(dataset: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces, reference displacements and made-up predictions of the test split."""
    grid = dataset.geometry.grid
    force = grid.to_nodes(dataset.test.force.double().numpy())
    reference = grid.to_nodes(dataset.test.displacement.double().numpy())
    return force, reference, 0.9 * reference
