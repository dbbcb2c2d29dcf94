"""Drawn meshes: faces and edges counted by hand, arrows of loads, and what the surface hides."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from shared_schema.common.bodies.cells import boundary_facets, sharp_edges
from shared_schema.common.drawing.drawing import (
    Drawing,
    load_symbols,
    surface_edges,
    surface_faces,
)
from shared_schema.common.drawing.figure_style import save
from shared_schema.common.drawing.mesh_drawing import DepthBuffer, make_drawing

ELEVATION, AZIMUTH = np.deg2rad(22), np.deg2rad(-62)
UP = np.array(
    [
        -np.sin(ELEVATION) * np.cos(AZIMUTH),
        -np.sin(ELEVATION) * np.sin(AZIMUTH),
        np.cos(ELEVATION),
    ]
)
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0])
EYE = np.cross(RIGHT, UP)
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
class DrawnBody:
    """A mesh that can be drawn."""

    coordinates: np.ndarray
    cells: np.ndarray
    cell_type: str


def tube(inner: float, outer: float, length: float, around: int = 32) -> DrawnBody:
    """Make a tube along z of hexahedra, two through its wall and eight along it."""
    through, along = 2, 8
    angle = np.arange(around) * 2 * np.pi / around
    radius, height = np.linspace(inner, outer, through + 1), np.linspace(0, length, along + 1)
    a, r, z = (g.ravel() for g in np.meshgrid(angle, radius, height, indexing="ij"))
    number = np.arange(len(a)).reshape(around, through + 1, along + 1)
    low = number, np.roll(number, -1, axis=0)
    corners = [
        low[i][:, j : j + through, k : k + along].ravel()
        for k in (0, 1)
        for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    ]
    x = np.stack((r * np.cos(a), r * np.sin(a), z), axis=1)
    return DrawnBody(x, np.stack(corners, axis=1), "hexahedron")


def box(*shape: int) -> DrawnBody:
    """Make a grid of so many nodes along each axis, 1 m apart."""
    number = np.arange(int(np.prod(shape))).reshape(shape)
    low, high = slice(None, -1), slice(1, None)
    corners: list[Any] = [(low, low), (high, low), (high, high), (low, high)]
    if len(shape) == 3:
        corners = [(*corner, z) for z in (low, high) for corner in corners]
    cells = np.stack([number[corner].ravel() for corner in corners], axis=1)
    return DrawnBody(np.argwhere(number >= 0) * 1.0, cells, ("quad", "hexahedron")[len(shape) - 2])


def ball(radius: float, n: int = 12) -> DrawnBody:
    """Make a ball of hexahedra, a cube of n cells a side pressed into its round shape."""
    whole = box(n + 1, n + 1, n + 1)
    cube = whole.coordinates * 2 / n - 1
    largest = np.abs(cube).max(axis=1, keepdims=True)
    length = np.linalg.norm(cube, axis=1, keepdims=True)
    x = radius * cube * np.divide(largest, length, out=np.zeros_like(largest), where=length > 0)
    return DrawnBody(x, whole.cells, "hexahedron")


def at_radius(body: DrawnBody, radius: float) -> np.ndarray:
    return np.isclose(np.hypot(*body.coordinates[:, :2].T), radius)


def pressed(body: DrawnBody, radius: float) -> np.ndarray:
    """Forces outwards at the nodes of a tube's wall."""
    force = np.zeros_like(body.coordinates)
    wall = at_radius(body, radius)
    force[wall, :2] = body.coordinates[wall, :2]
    return force


def drawn(body: DrawnBody, force: np.ndarray) -> tuple[list[Any], list[Any], bool]:
    """Arrows, shadings, and whether the magnitudes are written."""
    drawing = make_drawing(Figure(), body)
    said = drawing.forces(body.coordinates, force)
    return list(drawing.axes.texts), list(drawing.axes.collections), said


def test_three_forces_have_an_arrow_each() -> None:
    body = ball(1.0, 6)
    force = np.zeros_like(body.coordinates)
    force[[0, 100, 200]] = ((1.0, 0, 0), (0, 2, 0), (0, 0, 3))
    symbols = load_symbols(body, body.coordinates, force)
    assert [s.nodes.tolist() for s in symbols] == [[0], [100], [200]]
    assert not any(s.distributed for s in symbols)


def test_a_body_force_is_one_arrow_from_the_middle() -> None:
    body = ball(1.0, 6)
    force = np.tile((0.0, 0.0, -2.0), (len(body.coordinates), 1))
    (symbol,) = load_symbols(body, body.coordinates, force)
    assert symbol.inside
    assert symbol.force == pytest.approx((0, 0, -2.0 * 7**3))
    assert symbol.at == pytest.approx((0, 0, 0), abs=1e-12)
    arrows, shadings, said = drawn(body, force)
    assert sum(bool(a.get_text()) for a in arrows) == 1
    assert "686 N" in [a.get_text() for a in arrows]
    assert not shadings
    assert said


def test_a_pressure_is_a_shading_without_an_arrow_where_it_balances() -> None:
    body = tube(0.5, 1.0, 2.0)
    arrows, (shading,), said = drawn(body, pressed(body, 0.5))
    assert not arrows
    assert shading.get_hatch()
    assert not said


def test_a_pressure_on_one_side_has_its_resultant() -> None:
    body = tube(0.5, 1.0, 2.0)
    force = -pressed(body, 1.0)
    force[body.coordinates[:, 0] < 0.2] = 0
    (symbol,) = load_symbols(body, body.coordinates, force)
    assert symbol.distributed
    assert not symbol.inside
    assert symbol.force == pytest.approx(force.sum(axis=0))
    arrows, shadings, _ = drawn(body, force)
    assert any(f"{np.linalg.norm(force.sum(axis=0)):.3g} N" == a.get_text() for a in arrows)
    assert len(shadings) == 1


def test_a_force_on_a_pressed_wall_keeps_its_arrow() -> None:
    body = tube(0.5, 1.0, 2.0)
    force = pressed(body, 1.0)
    node = int(np.flatnonzero(at_radius(body, 1.0))[40])
    force[node] += (0, 0, 30.0)
    single, wall = load_symbols(body, body.coordinates, force)
    assert single.nodes.tolist() == [node]
    assert not single.distributed
    assert wall.distributed
    assert node not in wall.nodes


def test_a_traction_in_the_plane_shades_its_edge() -> None:
    """Twenty loaded edges of a strip, its lower boundary."""
    strip = box(21, 3)
    force = np.where(strip.coordinates[:, [1]] == 0, (0.0, -1.0), 0.0)
    arrows, (band,), said = drawn(strip, force)
    assert len(arrows) == 2  # the arrow, and its text
    assert len(band.get_paths()) == 20
    assert said


def ends(body: DrawnBody, part: str) -> np.ndarray:
    """Ends of all lines of a drawing, (n, 2, 2)."""
    drawing = make_drawing(Figure(), body)
    if part == "mesh":
        drawing.mesh(body.coordinates, "red", None)
    else:
        drawing.undeformed("red", None)
    lines: Any = drawing.axes.collections[0]
    return np.array([path.vertices for path in lines.get_paths()])


def test_a_face_in_front_hides_a_point_behind() -> None:
    """The unit square at depth 0 hides a point at depth 1 within it, not beside it."""
    paper = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    buffer = DepthBuffer(paper, np.zeros(4), np.array([[0, 1, 2, 3]]))
    points = np.array([[0.5, 0.5], [0.9, 0.2], [1.1, 0.5], [0.5, 0.5]])
    depth = np.array([1.0, 1.0, 1.0, -1.0])
    assert buffer.hides(points, depth).tolist() == [True, True, False, False]


def test_the_outline_of_a_ball_is_a_circle() -> None:
    """Every point at 0.9 to 1 of the radius, in all directions without a gap of 10°."""
    points = ends(ball(2.0, 16), "outline").reshape(-1, 2)
    assert ((np.linalg.norm(points, axis=1) > 1.8) & (np.linalg.norm(points, axis=1) < 2.001)).all()
    angle = np.sort(np.arctan2(points[:, 1], points[:, 0]))
    assert np.diff(angle, append=angle[0] + 2 * np.pi).max() < np.deg2rad(20)


def test_the_wall_behind_is_hidden() -> None:
    """Of a tube closed to the eye, no line lies inside its outer contour but at its mouth.

    Seen from 22° above: of the inner wall of a long tube only the part is seen that is less than
    2 r tan 22° below the mouth.
    """
    body = tube(0.5, 1.0, 6.0)
    seen = make_drawing(Figure(), body).seen_nodes(body.coordinates)
    x = body.coordinates[seen]
    inner = np.isclose(np.hypot(x[:, 0], x[:, 1]), 0.5)
    assert inner.any()
    assert x[inner, 2].min() > 6.0 - 2 * 0.5 * np.tan(ELEVATION) - 6.0 / 8
    outer = np.isclose(np.hypot(x[:, 0], x[:, 1]), 1.0)
    below = outer & (x[:, 2] < 6.0)
    assert (x[below] @ EYE > -0.2 + x[below, 2] * EYE[2]).all()


def test_lines_of_a_cavity_do_not_shine_through() -> None:
    """A box around a closed hole: the same lines as the box without it."""
    n = 6
    solid = box(n + 1, n + 1, n + 1)
    x, cells = solid.coordinates, solid.cells
    hole = (np.abs(x[cells].mean(axis=1) / n - 0.5) < 0.2).all(axis=1)
    hollow = DrawnBody(x, cells[~hole], "hexahedron")
    assert len(boundary_facets(hollow.cells, "hexahedron")) == 6 * n * n + 6 * 2 * 2
    for part in ("mesh", "outline"):
        assert len(ends(hollow, part)) == len(ends(solid, part))


def block(cell_type: str) -> DrawnBody:
    whole = box(8, 4) if cell_type in ("quad", "triangle") else box(8, 4, 4)
    parts, cells = {"triangle": HALVES, "tetra": SIXTHS}.get(cell_type), whole.cells
    if parts is not None:
        cells = np.concatenate([cells[:, part] for part in parts])
    return DrawnBody(whole.coordinates * 0.5, cells, cell_type)


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


def finished(mesh: DrawnBody, force: np.ndarray) -> tuple[Figure, Drawing]:
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


def test_a_force_along_the_line_of_sight_is_drawn(tmp_path: Path) -> None:
    """It is a point on the paper, with its text."""
    mesh = block("hexahedron")
    force = np.zeros_like(mesh.coordinates)
    force[-1] = EYE
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
    for corners, corner in ((last, (3.5, 0.0, 1.5)), (first, (0.0, 1.5, 1.5))):
        place = np.array((RIGHT @ corner, UP @ corner))
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
