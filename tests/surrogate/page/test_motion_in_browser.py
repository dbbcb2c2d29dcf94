"""The page in motion: pull, let go, hold and push, step by step, as `surrogate.Session` moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.tools import Sphere
from tests.surrogate.page.browser import OpenPage

pytestmark = [pytest.mark.browser, pytest.mark.slow]

Open = Callable[..., OpenPage]
STEP = 1 / 60  # s
DENSITY = 0.1  # kg/m³: the beam swings in 1.3 s
CLOSE = 1e-4  # of the largest displacement, of a session that is exact


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "beam.html"
    surrogate.write_page("beam2d_any", path, density=DENSITY)
    return path


@pytest.fixture(scope="module")
def model() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.fixture
def page(beam: Path, open_page: Open) -> OpenPage:
    """The page in motion, whose steps are taken by hand; turning it on takes the first one."""
    page = open_page(beam)
    page.begin_motion()
    return page


def session(model: surrogate.Surrogate) -> surrogate.Session:
    return surrogate.Session(model, density=DENSITY, tolerance=1e-7)


def test_pull_and_let_go(page: OpenPage, model: surrogate.Surrogate) -> None:
    """The tip goes on through its place at rest and comes back, as by the program."""
    tip = model.geometry.tip
    x, y = page.pixel(tip)
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 10, y + 60)
    page.settle()
    force = page.forces
    assert np.flatnonzero(force.any(axis=1)).tolist() == [tip]
    pulled = page.take(20)
    mouse.up()
    page.settle()
    assert not page.forces.any()
    swings = page.take(100)
    way = swings[:, tip, 1]
    assert pulled[-1, tip, 1] < -0.1
    assert way.max() > 0.1
    assert way[way.argmax() :].min() < -0.1  # a whole period
    moving = session(model)
    moving.begin(acting=0 * force)
    expected = [moving.step(STEP, load).displacement for load in [force] * 20 + [0 * force] * 100]
    found = np.concatenate([pulled, swings])
    assert np.abs(found - expected).max() < CLOSE * np.abs(expected).max()
    assert "that the time step adds" in page.text("#estimate")
    assert page.text("#pace").startswith("2.0")  # s


def test_damping_reset_and_the_end_of_motion(page: OpenPage, model: surrogate.Surrogate) -> None:
    """A vibration of damping ratio 0.1 has exp(−2π · 0.1) of its size after a period."""
    tip = model.geometry.tip
    page.load(tip, 0.0, -0.01)
    page.page.locator("#damping input[type=number]").fill("0.5")
    page.take(600)
    (static,) = page.take(1)
    page.page.locator("#damping input[type=number]").fill("0.1")
    page.page.get_by_text("Remove all").click()
    page.settle()
    way = page.take(100)[:, tip, 1] / static[tip, 1]
    highest = int(way[60:].argmax()) + 60
    assert 70 < highest < 80  # 2π / ω = 1.26 s
    assert way[highest] == pytest.approx(np.exp(-0.2 * np.pi), rel=0.1)
    page.page.click("#reset")
    page.settle()
    assert not page.take(1).any()
    page.page.locator("#motion .choices input").uncheck()
    page.load(tip, 0.0, -0.01)
    at_rest = page.field("displacement")
    assert np.abs(at_rest - static).max() < 0.01 * np.abs(static).max()


def test_a_held_place_is_led_and_let_go(page: OpenPage, model: surrogate.Surrogate) -> None:
    tip = model.geometry.tip
    page.page.check("input[value=hold]")
    x, y = page.pixel(tip)
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    for down in (10, 20, 30):
        mouse.move(x, y + down)
        page.settle()
        held = page.take(2)[-1, tip]  # the first one begins where it was
        wanted = page.page.evaluate("surrogatePage.state.loads.selected.held")
        np.testing.assert_allclose(held, wanted, atol=2e-4 * abs(wanted[1]))
    mouse.up()
    assert page.take(60)[:, tip, 1].max() > 0.05


def test_a_sphere_pushes(page: OpenPage, model: surrogate.Surrogate) -> None:
    """No node enters the sphere, and the body is where the program has it."""
    page.page.check("input[value=push]")
    x, y = page.pixel(int(np.abs(model.geometry.coordinates - [3.2, 1]).sum(axis=1).argmin()))
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    moving = session(model)
    depth, found, expected = 0.0, [], []
    for down in range(0, 30, 2):
        mouse.move(x, y + down)
        page.settle()
        (frame,) = page.take(1)
        tool = page.page.evaluate("surrogatePage.state.tool")
        sphere = Sphere(tuple(tool["centre"]), tool["radius"])
        np.testing.assert_allclose(tool["centre"], tool["wanted"])
        depth = min(depth, sphere.gap(model.geometry.coordinates + frame).min())
        found.append(frame)
        expected.append(moving.step(STEP, tool=sphere).displacement)
    size = np.abs(expected).max()
    assert size > 0.1
    assert depth > -2e-4 * size
    assert np.abs(np.array(found) - expected).max() < 0.01 * size
