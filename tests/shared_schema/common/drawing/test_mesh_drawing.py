"""Faces and edges counted by hand, where arrows stand, and that every kind of mesh is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from shared_schema.common.bodies.cells import sharp_edges
from shared_schema.common.drawing.drawing import (
    Drawing,
    cells_of_faces,
    surface_edges,
    surface_faces,
)
from shared_schema.common.drawing.figure_style import save
from shared_schema.common.drawing.mesh_drawing import make_drawing

HALVES = ((0, 1, 2), (0, 2, 3))  # of a quadrilateral
SIXTHS = (  # of a hexahedron, round its diagonal from corner 0 to 6
    (0, 1, 2, 6),
    (0, 2, 3, 6),
    (0, 3, 7, 6),
    (0, 7, 4, 6),
    (0, 4, 5, 6),
    (0, 5, 1, 6),
)


@dataclass(frozen=True)
class Block:
    """A box of 7 × 3 (× 3) cells of 0.5 m, quadrilaterals or hexahedra, perhaps cut up."""

    coordinates: np.ndarray
    cells: np.ndarray
    cell_type: str


def block(cell_type: str) -> Block:
    plane = cell_type in ("quad", "triangle")
    shape = (8, 4) if plane else (8, 4, 4)
    number = np.arange(int(np.prod(shape))).reshape(shape)
    low, high = slice(None, -1), slice(1, None)
    corners: list[Any] = [(low, low), (high, low), (high, high), (low, high)]
    if not plane:
        corners = [(*corner, z) for z in (low, high) for corner in corners]
    cells = np.stack([number[corner].ravel() for corner in corners], axis=1)
    parts = {"triangle": HALVES, "tetra": SIXTHS}.get(cell_type)
    if parts is not None:
        cells = np.concatenate([cells[:, part] for part in parts])
    return Block(np.argwhere(number >= 0) * 0.5, cells, cell_type)


CELL_TYPES = ["quad", "triangle", "hexahedron", "tetra"]


def test_plane_mesh() -> None:
    """7 × 3 cells: 21 faces; 7 · 4 horizontal and 8 · 3 vertical edges."""
    assert len(surface_faces(block("quad"))) == 21
    assert len(surface_edges(block("quad"))) == 7 * 4 + 8 * 3
    assert len(surface_faces(block("triangle"))) == 42
    assert len(surface_edges(block("triangle"))) == 7 * 4 + 8 * 3 + 21


@pytest.mark.parametrize(("cell_type", "parts"), [("hexahedron", 1), ("tetra", 2)])
def test_surface_of_a_mesh_in_space(cell_type: str, parts: int) -> None:
    """7 × 3 × 3 cells: 2 (21 + 21 + 9) faces, and by Euler V − E + F = 2."""
    mesh = block(cell_type)
    faces, edges = surface_faces(mesh), surface_edges(mesh)
    assert len(faces) == 2 * (7 * 3 + 7 * 3 + 3 * 3) * parts
    assert len(np.unique(faces)) - len(edges) + len(faces) == 2


@pytest.mark.parametrize("cell_type", ["hexahedron", "tetra"])
def test_sharp_edges_of_a_box(cell_type: str) -> None:
    """4 (7 + 3 + 3) pieces: on two faces of the box at once."""
    mesh = block(cell_type)
    edges = sharp_edges(mesh.coordinates, surface_faces(mesh))
    assert len(edges) == 4 * (7 + 3 + 3)
    at_faces = (mesh.coordinates == 0) | (mesh.coordinates == mesh.coordinates.max(axis=0))
    assert (at_faces[edges].all(axis=1).sum(axis=1) == 2).all()


def finished(mesh: Block, force: np.ndarray) -> tuple[Figure, Drawing]:
    figure = Figure()
    drawing = make_drawing(figure, mesh)
    drawing.body(mesh.coordinates, "black", "white")
    drawing.forces(mesh.coordinates, force)
    drawing.finish()
    return figure, drawing


@pytest.mark.parametrize("cell_type", CELL_TYPES)
def test_a_mesh_is_drawn(cell_type: str, tmp_path: Path) -> None:
    """A node's arrow, the mesh and the field leave more than one colour on the picture."""
    mesh = block(cell_type)
    x = mesh.coordinates
    figure = Figure()
    drawing = make_drawing(figure, mesh)
    drawing.body(x, "black", "white")
    drawing.field(x, np.linalg.norm(x, axis=1))
    drawing.mesh(x, "black", "mesh", linewidth=0.5)
    drawing.undeformed("0.5", "undeformed")
    drawing.markers(x[x[:, 0] == 0], "red", marker="s")
    force = np.zeros_like(x)
    force[-1, -1] = -1.5
    drawing.forces(x, force)
    drawing.finish()
    save(figure, tmp_path / "a.png")
    colours = imread(tmp_path / "a.png").reshape(-1, 4)[:, :3]
    assert len(np.unique(colours.round(2), axis=0)) > 50
    assert any("1.5 N" in text.get_text() for text in figure.axes[0].texts)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize("upwards", [1.0, -1.0])
def test_an_arrow_stands_outside_the_body(upwards: float) -> None:
    """At the upper edge, y = 1.5: from there to 0.16 · 3.5 m above, or from above to there."""
    mesh = block("quad")
    node = int(np.flatnonzero((mesh.coordinates == (2.0, 1.5)).all(axis=1))[0])
    force = np.zeros_like(mesh.coordinates)
    force[node, 1] = upwards
    _, drawing = finished(mesh, force)
    arrow: Any = drawing.axes.texts[0]
    low, high = (2.0, 1.5), (2.0, 1.5 + 0.16 * 3.5)
    head, tail = (high, low) if upwards > 0 else (low, high)
    assert arrow.xy == pytest.approx(head)
    assert arrow.xyann == pytest.approx(tail)


def test_many_forces_are_drawn_in_proportion_without_text() -> None:
    mesh = block("quad")
    force = np.zeros_like(mesh.coordinates)
    top = mesh.coordinates[:, 1] == 1.5
    force[top, 1] = np.arange(1.0, 9.0)
    _, drawing = finished(mesh, force)
    arrows: list[Any] = list(drawing.axes.texts)
    assert [text.get_text() for text in arrows] == [""] * 8
    lengths = [arrow.xy[1] - arrow.xyann[1] for arrow in arrows]
    assert lengths == pytest.approx(0.16 * 3.5 * np.arange(1, 9) / 8)


@pytest.mark.parametrize(("distance", "texts"), [(1, 0), (2, 2)])
def test_texts_do_not_meet(distance: int, texts: int) -> None:
    """Arrows 0.5 m apart have none, those 1 m apart do: 0.2 · 3.5 m lies between."""
    mesh = block("quad")
    force = np.zeros_like(mesh.coordinates)
    top = np.flatnonzero(mesh.coordinates[:, 1] == 1.5)
    force[top[[2, 2 + distance]], 1] = 1.0
    _, drawing = finished(mesh, force)
    assert sum("1 N" in text.get_text() for text in drawing.axes.texts) == texts


def test_no_force_no_arrow() -> None:
    mesh = block("quad")
    _, drawing = finished(mesh, np.zeros_like(mesh.coordinates))
    assert not drawing.axes.texts


def test_a_force_along_the_line_of_sight_is_drawn(tmp_path: Path) -> None:
    """It is a point on the paper, with its text."""
    mesh = block("hexahedron")
    force = np.zeros_like(mesh.coordinates)
    elevation, azimuth = np.deg2rad(22), np.deg2rad(-62)
    force[-1] = (
        np.cos(elevation) * np.cos(azimuth),
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
    )
    figure, drawing = finished(mesh, force)
    save(figure, tmp_path / "a.png")
    assert any("1 N" in text.get_text() for text in drawing.axes.texts)


def test_the_nearest_face_is_drawn_last() -> None:
    """Seen from the front right above: the corner at greatest x, least y, greatest z."""
    mesh = block("hexahedron")
    figure = Figure()
    drawing = make_drawing(figure, mesh)
    drawing.body(mesh.coordinates, "black", "white")
    first, *_, last = (
        np.asarray(path.vertices) for path in drawing.axes.collections[0].get_paths()
    )
    elevation, azimuth = np.deg2rad(22), np.deg2rad(-62)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    up = np.array(
        [
            -np.sin(elevation) * np.cos(azimuth),
            -np.sin(elevation) * np.sin(azimuth),
            np.cos(elevation),
        ]
    )
    for corners, corner in ((last, (3.5, 0.0, 1.5)), (first, (0.0, 1.5, 1.5))):
        place = np.array((right @ corner, up @ corner))
        assert np.linalg.norm(corners - place, axis=1).min() < 1e-12


def test_axes_in_space_are_of_a_round_length() -> None:
    """3.5 m long: the largest of 1, 2, 5, 10, … that is not above a quarter of that is 0.5 m."""
    mesh = block("tetra")
    _, drawing = finished(mesh, np.zeros_like(mesh.coordinates))
    said = [text.get_text() for text in drawing.axes.texts if text.get_text()]
    assert said == ["x", "y", "z", "0.5 m"]


@pytest.mark.parametrize(("cell_type", "parts"), [("hexahedron", 1), ("tetra", 2)])
def test_only_edges_in_front_are_drawn_in_space(cell_type: str, parts: int) -> None:
    """Three sides of the box: 51 faces, 8 · 4 + 8 · 4 + 4 · 4 − 16 + 1 nodes; V − E + F = 1."""
    mesh = block(cell_type)
    drawing = make_drawing(Figure(), mesh)
    drawing.mesh(mesh.coordinates, "red", None)
    (lines,) = drawing.axes.collections
    faces, nodes = (21 + 21 + 9) * parts, 65
    assert len(lines.get_paths()) == nodes + faces - 1


@pytest.mark.parametrize("cell_type", ["triangle", "quad", "tetra", "hexahedron"])
def test_cells_of_faces(cell_type: str) -> None:
    """Every face has the corners of its cell."""
    mesh = block(cell_type)
    faces = surface_faces(mesh)
    for face, cell in zip(faces, cells_of_faces(mesh, faces), strict=True):
        assert set(face) <= set(mesh.cells[cell])


def test_directions_of_cells() -> None:
    """Lines of 0.6 · 0.5 m along the diagonal, through the middles; none where there is none."""
    mesh = block("quad")
    vectors = np.full((len(mesh.cells), 2), np.sqrt(0.5))
    vectors[1:] = 0.0
    drawing = make_drawing(Figure(), mesh)
    drawing.directions(vectors, "black")
    lines: Any = drawing.axes.collections[-1]
    (line,) = lines.get_segments()
    middle = mesh.coordinates[mesh.cells[0]].mean(axis=0)
    assert line == pytest.approx(middle + 0.15 * np.sqrt(0.5) * np.array([[-1, -1], [1, 1]]))
