"""One symbol for a distributed load: its resultant is the sum of the nodal forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from shared_schema.common.drawing.drawing import load_symbols
from shared_schema.common.drawing.mesh_drawing import make_drawing
from tests.shared_schema.common.drawing.bodies import DrawnBody, ball, tube


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
    number = np.arange(21 * 3).reshape(21, 3)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    cells = np.stack([c.ravel() for c in corners], axis=1)
    strip = DrawnBody(np.argwhere(number >= 0) * 0.1, cells, "quad")
    force = np.where(strip.coordinates[:, [1]] == 0, (0.0, -1.0), 0.0)
    arrows, (band,), said = drawn(strip, force)
    assert len(arrows) == 2  # the arrow, and its text
    assert len(band.get_paths()) == 20
    assert said
