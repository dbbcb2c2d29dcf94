"""Faces and edges counted by hand, and that both drawings draw them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from surrogate import figures
from surrogate.dataset import Dataset
from surrogate.mesh_drawing import make_drawing, surface_edges, surface_faces


def test_plane_mesh(dataset: Dataset) -> None:
    """7 × 3 cells: 21 faces; 7 · 4 horizontal and 8 · 3 vertical edges."""
    assert len(surface_faces(dataset.geometry)) == 21
    assert len(surface_edges(dataset.geometry)) == 7 * 4 + 8 * 3


def test_surface_of_a_mesh_in_space(dataset_3d: Dataset) -> None:
    """7 × 3 × 3 cells: 2 (21 + 21 + 9) faces, and by Euler V − E + F = 2."""
    faces, edges = surface_faces(dataset_3d.geometry), surface_edges(dataset_3d.geometry)
    assert len(faces) == 2 * (7 * 3 + 7 * 3 + 3 * 3)
    assert len(np.unique(faces)) - len(edges) + len(faces) == 2


@pytest.mark.parametrize("kind", ["dataset", "dataset_3d"])
def test_a_mesh_is_drawn(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """A node's arrow, the mesh and the field leave more than one colour on the picture."""
    geometry = request.getfixturevalue(kind).geometry
    x = geometry.coordinates
    figure = Figure()
    drawing = make_drawing(figure, geometry)
    drawing.field(x, np.linalg.norm(x, axis=1))
    drawing.mesh(x, "black", "mesh", linewidth=0.5)
    force = np.zeros_like(x)
    force[geometry.tip, -1] = -1.5
    drawing.forces(x, force)
    drawing.finish()
    figures.save(figure, tmp_path / "a.png")
    colours = imread(tmp_path / "a.png").reshape(-1, 4)[:, :3]
    assert len(np.unique(colours.round(2), axis=0)) > 50
    assert any("1.50 N" in text.get_text() for text in figure.axes[0].texts)
