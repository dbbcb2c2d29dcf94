"""The page of the shipped network of the 2D beam, driven by mouse and keys in Chromium."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from surrogate.command_line import main
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.page.page import write_page
from tests.surrogate.page.browser import OpenPage

pytestmark = [pytest.mark.browser, pytest.mark.slow]

RELATIVE = 1e-4
Open = Callable[..., OpenPage]


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "beam.html"
    write_page(Path("beam2d_any"), path)
    return path


@pytest.fixture(scope="module")
def model() -> Surrogate:
    return load("beam2d_any")


def corner(model: Surrogate) -> int:
    """The upper node of the free end."""
    return int((model.geometry.coordinates @ [1, 1]).argmax())


def assert_as_predicted(page: OpenPage, model: Surrogate) -> None:
    """The page's displacement is that of `surrogate predict` under the page's forces."""
    expected = model.averaged_passes(page.forces).mean
    found = page.field("displacement")
    assert np.abs(found - expected).max() < RELATIVE * np.abs(expected).max()


def test_dragged_corner_follows_as_predicted(beam: Path, model: Surrogate, open_page: Open) -> None:
    page, tip = open_page(beam), corner(model)
    page.drag(tip, right=-20, up=90)
    forces = page.forces
    assert np.flatnonzero(forces.any(axis=1)).tolist() == [tip]
    # the pull in metres, by the width of the beam in pixels, times the arrow's stiffness
    pixels = page.page.evaluate(
        "(() => { const a = surrogatePage.scene; const p = a.body.at(0).clone();"
        " const q = p.clone(); q.x += 1; return a.project(q).x - a.project(p).x; })()"
    )
    limit = max(model.description.data.info.force.max_abs)
    stiffness = limit / (0.25 * np.sqrt(4**2 + 1**2))
    np.testing.assert_allclose(forces[tip], np.array([-20, 90]) / pixels * stiffness, rtol=1e-6)
    expected = model.averaged_passes(forces).mean[tip]
    found = page.field("displacement")[tip]
    assert np.linalg.norm(found - expected) < RELATIVE * np.linalg.norm(expected)
    assert np.linalg.norm(expected) > 0.2  # m: a large displacement
    assert page.text("#warnings") == ""


def test_two_loads_and_their_removal(beam: Path, model: Surrogate, open_page: Open) -> None:
    page, tip = open_page(beam), corner(model)
    below = int(np.abs(model.geometry.coordinates - [2, 0]).sum(axis=1).argmin())
    page.drag(tip, right=30, up=40)
    page.drag(below, right=0, up=-50)
    assert set(np.flatnonzero(page.forces.any(axis=1))) == {tip, below}
    assert_as_predicted(page, model)
    page.page.locator(".load").first.get_by_label("Remove the load").click()
    page.settle()
    assert np.flatnonzero(page.forces.any(axis=1)).tolist() == [below]
    assert_as_predicted(page, model)
    page.page.get_by_text("Remove all").click()
    page.settle()
    assert page.page.evaluate("surrogatePage.state.fields") is None


def test_a_load_is_continued_by_a_second_drag(
    beam: Path, model: Surrogate, open_page: Open
) -> None:
    page, tip = open_page(beam), corner(model)
    page.drag(tip, right=0, up=30)
    once = page.forces[tip]
    page.drag(tip, right=0, up=30)
    np.testing.assert_allclose(page.forces[tip], 2 * once, rtol=1e-6, atol=1e-9)


def test_typed_load_estimate_and_command(
    beam: Path, model: Surrogate, open_page: Open, tmp_path: Path
) -> None:
    """The command of the page, run as it is, writes the fields that the page saves."""
    page, tip = open_page(beam), corner(model)
    page.load(tip, 0.25, -1.5)
    np.testing.assert_array_equal(page.forces[tip], [0.25, -1.5])
    error, settled = page.certificate()
    page.settle()
    certificate = model.certify(page.forces, page.field("displacement"))
    assert settled
    assert bool(certificate.settled)
    assert np.abs(error - certificate.error).max() < 0.05 * float(certificate.max_error)
    assert "% of the largest displacement" in page.text("#estimate")

    words = shlex.split(page.text("#panel code"))
    out = tmp_path / "predicted.npz"
    assert words[:2] == ["surrogate", "predict"]
    assert words[-1] == "prediction.npz"
    assert main([*words[1:-1], str(out)]) == 0
    with np.load(out) as file, np.load(page.saved("npz", tmp_path)) as saved:
        assert {*saved, "predicted"} == {*file, "predicted", "estimated_error"}
        for name in ("coordinates", "force"):
            np.testing.assert_array_equal(saved[name], file[name])
        largest = np.abs(file["displacement"]).max()
        difference = np.abs(saved["displacement"] - file["displacement"]).max()
        assert difference < RELATIVE * largest
        table = np.genfromtxt(page.saved("csv", tmp_path), delimiter=",", names=True)
        assert table.dtype.names is not None
        assert table.dtype.names[:4] == ("x", "y", "force_x", "force_y")
        np.testing.assert_array_equal(table["displacement_y"], saved["displacement"][:, 1])
        np.testing.assert_array_equal(table["estimated_error_x"], saved["estimated_error"][:, 0])


def test_picture_shows_the_body_and_the_colour_bar(
    beam: Path, model: Surrogate, open_page: Open, tmp_path: Path
) -> None:
    page, tip = open_page(beam), corner(model)
    page.load(tip, 0.0, 1.5)
    x, y = page.pixel(tip)
    left, _ = page.pixel(int(np.abs(model.geometry.coordinates).sum(axis=1).argmin()))
    picture = matplotlib.image.imread(page.saved("png", tmp_path))[..., :3]
    size = page.page.evaluate(
        "[surrogatePage.scene.canvas.clientHeight, surrogatePage.scene.canvas.clientWidth]"
    )
    assert list(picture.shape[:2]) == size
    assert picture[3, 3].min() > 0.9  # light ground
    # inside the deformed body near the tip the colour is dark, near the support it is light
    near_tip = picture[int(y) + 12, int(x) - 12]
    assert near_tip.max() < 0.7
    bar = picture[-40, 20:310:20]
    brightness = bar.sum(axis=1)
    assert np.all(np.diff(brightness) < 0)  # from light to dark
    assert left < x


def test_keys_load_change_and_remove(beam: Path, model: Surrogate, open_page: Open) -> None:
    page = open_page(beam)
    press = page.page.keyboard.press
    page.page.locator("#stage canvas").focus()
    press(".")
    press("Enter")
    for _ in range(3):
        press("ArrowUp")
    press("Shift+ArrowRight")
    page.settle()
    first = int(np.flatnonzero(model.geometry.loadable)[0])
    step = 0.05 * max(model.description.data.info.force.max_abs)
    np.testing.assert_allclose(page.forces[first], [5 * step, 3 * step], rtol=1e-6)
    assert_as_predicted(page, model)
    press("Delete")
    page.settle()
    assert not page.forces.any()


def test_touch_drags_a_load(beam: Path, model: Surrogate, open_page: Open) -> None:
    page, tip = open_page(beam), corner(model)
    x, y = page.pixel(tip)
    session = page.page.context.new_cdp_session(page.page)
    for kind, up in (("touchStart", 0), ("touchMove", 30), ("touchMove", 60), ("touchEnd", 60)):
        points = [] if kind == "touchEnd" else [{"x": x, "y": y - up}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.settle()
    assert page.forces[tip, 1] > 0.1
    assert_as_predicted(page, model)


def test_readout_and_curve(beam: Path, model: Surrogate, open_page: Open) -> None:
    page, tip = open_page(beam), corner(model)
    page.drag(tip, right=0, up=60, steps=5)
    u = page.field("displacement")[tip]
    assert f"{1e3 * u[1]:.4g} mm" in page.text("#panel dl")
    points = page.page.evaluate("surrogatePage.curve.points.map((p) => [p.force, p.displacement])")
    np.testing.assert_allclose(
        points[-1], [np.linalg.norm(page.forces[tip]), np.linalg.norm(u)], rtol=1e-6
    )
    assert len(points) > 1


def test_narrow_and_wide_screens_hold_the_page(
    beam: Path, model: Surrogate, open_page: Open
) -> None:
    for width, height in ((360, 740), (1600, 900)):
        page = open_page(beam, width, height)
        page.load(corner(model), 0.5, 0.5)
        assert page.page.evaluate("document.documentElement.scrollWidth") <= width
        for button in page.page.locator("#panel button:visible").all():
            box = button.bounding_box()
            assert box is not None
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width


def test_first_frame_comes_before_the_network(beam: Path, open_page: Open) -> None:
    page = open_page(beam)
    marks = page.page.evaluate("performance.getEntriesByType('mark').map((m) => m.name)")
    assert marks == ["first frame", "ready"]


def test_lines_of_large_meshes_are_drawn_once_the_picture_stands_still(
    beam: Path, model: Surrogate, open_page: Open
) -> None:
    """Where a processor draws; a saved picture has them."""
    page = open_page(beam)
    shown = "surrogatePage.scene.body.mesh.visible"
    page.drag(corner(model), right=0, up=50)
    assert page.page.evaluate(shown)  # few lines do not wait
    page.page.evaluate("surrogatePage.scene.linesWait = true")
    assert not page.page.evaluate(f"(surrogatePage.scene.draw(), {shown})")
    page.page.evaluate(
        f"new Promise((done) => {{ const ask = () => {shown} ? done() : setTimeout(ask, 10);"
        " ask(); })"
    )
    assert page.page.evaluate(
        f"(surrogatePage.scene.draw(), surrogatePage.scene.drawWhole(), {shown})"
    )
