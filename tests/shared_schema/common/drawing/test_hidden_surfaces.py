"""What the surface hides is not drawn: far side and cavities; a ball's outline is a circle."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.drawing.mesh_drawing import DepthBuffer, make_drawing
from tests.shared_schema.common.drawing.bodies import DrawnBody, ball, tube

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
    number = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    low, high = slice(None, -1), slice(1, None)
    square = ((low, low), (high, low), (high, high), (low, high))
    cells = np.stack([number[(*s, z)].ravel() for z in (low, high) for s in square], axis=1)
    x = np.argwhere(number >= 0) / n
    hole = (np.abs(x[cells].mean(axis=1) - 0.5) < 0.2).all(axis=1)
    hollow = DrawnBody(x, cells[~hole], "hexahedron")
    assert len(boundary_facets(hollow.cells, "hexahedron")) == 6 * n * n + 6 * 2 * 2
    solid = DrawnBody(x, cells, "hexahedron")
    for part in ("mesh", "outline"):
        assert len(ends(hollow, part)) == len(ends(solid, part))
