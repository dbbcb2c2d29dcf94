"""Sliders of actuators, beside a load and a sphere, and a target, on a page in Chromium."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.tools import Sphere
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.statics.load import Load
from surrogate.page.page_actuators import sliders
from tests.surrogate.page.actuated import chambered, run_of
from tests.surrogate.page.browser import OpenPage
from tests.surrogate.page.test_touch_in_browser import pushed

pytestmark = [pytest.mark.browser, pytest.mark.slow]

GIVEN = {"air": 100.0, "rope": 30.0}


def test_sliders_loads_and_targets(
    dataset_3d: Dataset, open_page: Callable[..., OpenPage], tmp_path: Path
) -> None:
    run = run_of(chambered(), dataset_3d, tmp_path / "run")
    model = surrogate.load(run)
    actuation = surrogate.Actuation.fit(model.body, samples=8)
    actuation.save(run / "actuation.safetensors")
    assert surrogate.write_page(run, tmp_path / "page.html").estimates
    page, tip = open_page(tmp_path / "page.html"), model.geometry.tip
    numbers = page.page.locator("#actuators input[type=number]")
    expected = actuation.at(GIVEN)
    size = float(np.linalg.norm(expected.displacement[tip]))

    for number, value in enumerate(GIVEN.values()):
        numbers.nth(number).fill(str(value))
    page.settle()
    found = page.field("displacement")
    assert np.linalg.norm(found[tip] - expected.displacement[tip]) < 1e-3 * size
    readings = page.page.locator("#actuators p").all_inner_texts()
    said = [f"{value:.4g}" for value in expected.quantities.values()]
    assert all(value in text for value, text in zip(said, readings, strict=True))

    page.certificate()  # the equilibrium of the finite elements takes its place
    exact = actuation.confirmed(expected).displacement
    assert np.abs(page.field("displacement") - exact).max() < 1e-4 * size
    words, out = shlex.split(page.text("#panel code")), tmp_path / "prediction.npz"
    assert main([*words[1:-1], str(out)]) == 0
    with np.load(out) as file:
        assert np.abs(file["displacement"] - exact).max() < 1e-4 * size

    page.load(tip, 0.0, 0.0, -3.0)  # a load that the modes do not know
    load = Load.of(model.geometry, page.forces, actuate=GIVEN)
    beside = model.body.correct(load, exact).displacement
    moved = np.linalg.norm(beside[tip] - exact[tip])
    assert np.linalg.norm(page.field("displacement")[tip] - beside[tip]) < 0.1 * moved
    page.certificate()
    assert np.abs(page.field("displacement") - beside).max() < 1e-4 * size

    page.page.get_by_text("Remove all").click()
    page.settle()
    assert page.page.evaluate("surrogatePage.state.fields") is None

    goal = (model.geometry.coordinates + expected.displacement)[tip]
    here, there = page.pixel(tip), page.pixel_of(goal)
    page.page.check("input[value=reach]")
    page.drag(tip, there[0] - here[0], here[1] - there[1], steps=4)
    target = page.page.evaluate("surrogatePage.state.target.place")
    within = {each["name"]: (each["low"], each["high"]) for each in sliders(actuation)}
    place = ",".join(map(str, model.geometry.coordinates[tip]))
    reached = actuation.reach({place: target}, within=within)
    apart = page.field("displacement")[tip] - reached.displacement[tip]
    assert np.linalg.norm(apart) < 1e-2 * size
    missed = page.page.evaluate("surrogatePage.state.actuated.missed")
    assert missed == pytest.approx(reached.missed, abs=1e-2 * size)
    assert page.text("#reached") == "The target is reached."
    page.drag(tip, 120, 90, steps=4)
    assert "out of reach" in page.text("#reached")

    page.page.get_by_text("Remove all").click()  # beside a sphere, as Touch finds it
    for number, value in enumerate(GIVEN.values()):
        numbers.nth(number).fill(str(value))
    tool, actuated = pushed(page, tip, down=-45), Load.of(model.geometry, actuate=GIVEN)
    touch = surrogate.Touch(model)
    for away in np.linspace(tool.radius, 0, 7):
        centre = tuple(float(x) for x in np.subtract(tool.begin, (0, 0, away)))
        frame = touch.move(Sphere(centre, tool.radius), actuated)
    assert np.linalg.norm(frame.reaction) > 3
    apart = page.forces.sum(axis=0) - frame.reaction
    assert np.linalg.norm(apart) < 2e-2 * np.linalg.norm(frame.reaction)
    assert page.text("#tool-force").startswith("The sphere pushes by")
    assert np.abs(page.field("displacement") - frame.displacement).max() < 3e-2 * size
