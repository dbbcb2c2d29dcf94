"""Pages whose body is held, pushed by a sphere, or of another stiffness, beside the program."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.tools import Sphere
from surrogate.command_line import main
from tests.surrogate.page.browser import OpenPage

pytestmark = [pytest.mark.browser, pytest.mark.slow]

HELD = 2e-4  # residual over the held displacement
FORCES = 2e-3  # of forces that are sought, on the page and by the program
DEPTH = 2e-4  # of a node in the sphere, over the largest displacement
Open = Callable[..., OpenPage]


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "beam.html"
    surrogate.write_page("beam2d_any", path)
    return path


@pytest.fixture(scope="module")
def model() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def node_at(model: surrogate.Surrogate, *x: float) -> int:
    return int(np.abs(model.geometry.coordinates - x).sum(axis=1).argmin())


def pushed(page: OpenPage, node: int, down: float, steps: int = 6) -> Sphere:
    """Put the sphere on a node and drag it down by some pixels; where it is then."""
    page.page.check("input[value=push]")
    page.drag(node, right=0, up=-down, steps=steps)
    tool = page.page.evaluate("surrogatePage.state.tool")
    np.testing.assert_allclose(tool["centre"], tool["wanted"])
    return Sphere(tuple(tool["centre"]), tool["radius"])


def by_the_program(model: surrogate.Surrogate, tool: Sphere, way: float) -> NDArray[np.float64]:
    """Resultant of a sphere that has come from outside, along the last axis."""
    touch = surrogate.Touch(model, 1e-4, corrected=False)  # as the page
    last = np.eye(tool.dimension)[-1]
    for away in np.linspace(way, 0, 7):
        centre = tuple(float(value) for value in tool.begin + away * last)
        reaction = touch.move(Sphere(centre, tool.radius)).reaction
    return reaction


def test_a_drag_takes_hold_of_the_body(
    beam: Path, model: surrogate.Surrogate, open_page: Open
) -> None:
    page, tip, below = open_page(beam), node_at(model, 4, 1), node_at(model, 2, 0)
    page.page.check("input[value=hold]")
    page.drag(tip, right=-20, up=90)
    held = np.array(page.page.evaluate("surrogatePage.state.loads.all[0].held"))
    assert np.linalg.norm(held) > 0.3
    found = page.field("displacement")[tip]
    assert np.abs(found - held).max() < HELD * np.linalg.norm(held)
    grip = surrogate.Grip(model, ["4,1"])
    reaction = grip.move([held]).reactions[0]
    np.testing.assert_allclose(page.forces[tip], reaction, atol=FORCES * np.abs(reaction).max())
    assert ", held" in page.text(".load.selected .name")

    page.page.check("input[value=force]")  # a force beside it: the held corner stays
    page.drag(below, right=0, up=40)
    found = page.field("displacement")[tip]
    assert np.abs(found - held).max() < HELD * np.linalg.norm(held)
    beside = np.zeros_like(page.forces)
    beside[below] = page.forces[below]
    reaction = grip.move([held], beside).reactions[0]
    np.testing.assert_allclose(page.forces[tip], reaction, atol=FORCES * np.abs(reaction).max())

    page.load(tip, 0.0, 0.0)  # a typed force lets go
    assert page.page.evaluate("surrogatePage.state.loads.all[0].held") is None
    assert np.flatnonzero(page.forces.any(axis=1)).tolist() == [below]


def test_a_sphere_pushes_the_body(
    beam: Path, model: surrogate.Surrogate, open_page: Open, tmp_path: Path
) -> None:
    page, top = open_page(beam), node_at(model, 8 / 3, 1)
    tool = pushed(page, top, down=40)
    forces, u = page.forces, page.field("displacement")
    gap, largest = tool.gap(model.geometry.coordinates + u), np.abs(u).max()
    assert largest > 0.2
    assert gap.min() > -DEPTH * largest
    assert np.abs(gap[forces.any(axis=1)]).max() < DEPTH * largest
    reaction = by_the_program(model, tool, way=0.3)
    np.testing.assert_allclose(forces.sum(axis=0), reaction, atol=FORCES * abs(reaction[1]))
    assert f"{np.linalg.norm(reaction):.2g}" in page.text("#tool-force")

    words, out = shlex.split(page.text("#panel code")), tmp_path / "pushed.npz"
    assert main([*words[1:-1], str(out)]) == 0
    with np.load(out) as file:
        assert np.abs(file["displacement"] - u).max() < 5e-3 * largest  # --tolerance of the series

    page.page.get_by_text("Take it away").click()
    page.settle()
    assert page.page.evaluate("surrogatePage.state.fields") is None


def test_a_sphere_pushes_the_finger(open_page: Open, tmp_path: Path) -> None:
    """A body in space, and a network."""
    surrogate.write_page("finger3d", tmp_path / "finger.html")
    page, model = open_page(tmp_path / "finger.html"), surrogate.load("finger3d")
    x = model.geometry.coordinates
    extent = np.ptp(x, axis=0)
    top = node_at(model, *(x.min(axis=0) + extent * (0.7, 0.5, 1.0)))
    tool = pushed(page, top, down=40)
    assert page.text("#hint") == ""
    moved = x + page.field("displacement")
    assert tool.gap(moved[~model.geometry.clamped]).min() > -DEPTH * np.abs(moved - x).max()
    reaction = by_the_program(model, tool, way=float(tool.radius))
    size = np.linalg.norm(reaction)
    assert np.linalg.norm(page.forces.sum(axis=0) - reaction) < 5 * FORCES * size


def test_another_stiffness(
    beam: Path, model: surrogate.Surrogate, open_page: Open, tmp_path: Path
) -> None:
    """Twice the modulus at run time, with a force and a sphere beside it."""
    page, tip = open_page(beam), node_at(model, 4, 1)
    page.load(tip, 0.5, -1.5)
    page.page.locator("#stiffness input[type=number]").fill("1000")
    page.settle()
    page.certificate()
    expected = model.solve(page.forces, young_modulus=1000.0, tolerance=5e-3).displacement
    largest = np.abs(expected).max()
    assert np.abs(page.field("displacement") - expected).max() < 1e-4 * largest

    words, out = shlex.split(page.text("#panel code")), tmp_path / "stiffer.npz"
    assert words[words.index("--young-modulus") + 1] == "1000"
    assert main([*words[1:-1], str(out)]) == 0
    with np.load(out) as file:
        assert np.abs(file["displacement"] - expected).max() < 1e-4 * largest

    page.page.get_by_text("Remove all").click()
    tool = pushed(page, node_at(model, 8 / 3, 1), down=30)
    reaction = 2 * by_the_program(model, tool, way=0.3)
    np.testing.assert_allclose(page.forces.sum(axis=0), reaction, atol=FORCES * abs(reaction[1]))
