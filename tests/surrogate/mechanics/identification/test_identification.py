"""Forces, their place, stiffness and the field from markers with noise; wrong markers; refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError, WorkError
from surrogate import Markers, identify
from surrogate.command_line import main
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series
from tests.surrogate.mechanics.bodies import box
from tests.surrogate.mechanics.statics.test_cables import pulled

Array = NDArray[np.float64]
NOISE = 0.004  # m, of a beam of 4 m
CORNERS = ["4,1", "4,0"]


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def markers_in(model: surrogate.Surrogate, count: int, seed: int) -> tuple[Array, Array]:
    """Random places in the cells, and their interpolation, (m, n_nodes)."""
    rng, geometry = np.random.default_rng(seed), model.geometry
    cells = geometry.cells[rng.integers(len(geometry.cells), size=count)]
    if geometry.dimension == 2:  # bilinear weights of a rectangle
        s, r = rng.random((2, count))
        weights = np.stack([(1 - s) * (1 - r), s * (1 - r), s * r, (1 - s) * r], axis=1)
    at = np.zeros((count, len(geometry.coordinates)))
    at[np.arange(count)[:, None], cells] = weights
    return at @ geometry.coordinates, at


def seen(
    model: surrogate.Surrogate, field: Array, count: int = 20, seed: int = 0, noise: float = NOISE
) -> Markers:
    """Markers of a field, of which two are swapped and one is not seen."""
    x, at = markers_in(model, count, seed)
    y = x + at @ field + np.random.default_rng([seed, 1]).normal(0, noise, x.shape)
    y[[0, 1]], y[2] = y[[1, 0]], np.nan
    return Markers.of(x, y)


def test_forces_at_known_places(beam: surrogate.Surrogate) -> None:
    """Two corners, with a body force that is known; the swapped markers are left out."""
    truth = beam.solve(["4,1:0.8,-1.5", "4,0:-0.4,0.6"], body_force=(0, -0.1), correct=True)
    found = identify(beam, seen(beam, truth.displacement), CORNERS, body_force=(0, -0.1))
    assert found.names == ("4,1 x", "4,1 y", "4,0 x", "4,0 y")
    assert np.all(np.abs(found.values - (0.8, -1.5, -0.4, 0.6)) < 4 * found.std)
    np.testing.assert_allclose(found.values[1] + found.values[3], -0.9, rtol=0.02)
    assert found.left_out[[0, 1]].all()
    assert not found.left_out[2:].any()
    assert 0.7 * NOISE < found.noise < 1.3 * NOISE
    off = np.abs(found.displacement - truth.displacement)
    assert off.max() < 4 * NOISE
    assert (off < 3 * found.std_displacement + 1e-12).mean() > 0.9
    weight = beam.solve(body_force=(0, -0.1)).force.sum(axis=0)
    total = found.values[:2] + found.values[2:] + weight
    np.testing.assert_allclose(found.force.sum(axis=0), total, atol=1e-9)


@pytest.mark.parametrize("confirm", [False, True])
def test_exact_markers(beam: surrogate.Surrogate, confirm: bool) -> None:
    """Without noise: the forces and the field of the finite elements."""
    truth = beam.solve("4,1:1,-2", correct=True)
    x, at = markers_in(beam, 10, seed=3)
    markers = Markers.of(x, x + at @ truth.displacement)
    found = identify(beam, markers, ["4,1"], confirm=confirm)
    np.testing.assert_allclose(found.values, (1, -2), rtol=1e-4)
    np.testing.assert_allclose(found.displacement, truth.displacement, atol=1e-5)
    assert (found.surrogate_error == 0) == confirm


def test_place_of_a_force(beam: surrogate.Surrogate) -> None:
    """A force somewhere on the surface, which moves the beam far."""
    truth = beam.solve("2.4,1:1.5,-4", correct=True)
    found = identify(beam, seen(beam, truth.displacement, count=30), ["somewhere"])
    assert found.place is not None
    assert found.place_std is not None
    assert np.linalg.norm(found.place - (2.4, 1)) < 3 * found.place_std + 0.3
    assert np.linalg.norm(found.displacement - truth.displacement, axis=1).max() < 4 * NOISE
    exact = identify(beam, seen(beam, truth.displacement, count=30, noise=0), ["somewhere"])
    assert exact.place == pytest.approx((2.4, 1), abs=1e-9)
    np.testing.assert_allclose(exact.values, (1.5, -4), rtol=1e-3)


@pytest.mark.parametrize("said", ["somewhere,0.7", "somewhere,any"])
def test_force_that_is_spread(beam: surrogate.Surrogate, said: str) -> None:
    """Without noise: the force on the surface within 0.7 m, which no single node takes.

    A radius that is sought is one of 0, 0.27, 0.38, 0.53 and 0.75 m (the mean edge is 0.3 m).
    """
    truth = beam.solve("2.4,1,0.7:1.5,-4", correct=True)
    markers = seen(beam, truth.displacement, count=40, noise=1e-4)
    found = identify(beam, markers, [said])
    assert found.place == pytest.approx((2.4, 1), abs=0.3)
    assert found.radius == pytest.approx(0.7, abs=0.1)
    assert found.radius_std is not None
    assert "radius: " in repr(found)
    np.testing.assert_allclose(found.values, (1.5, -4), rtol=0.05)
    np.testing.assert_allclose(found.force.sum(axis=0), found.values, rtol=1e-9)
    off = np.linalg.norm(found.displacement - truth.displacement, axis=1).max()
    point = identify(beam, markers, ["somewhere"])
    assert point.radius == 0.0
    assert np.linalg.norm(point.displacement - truth.displacement, axis=1).max() > 3 * off


def test_what_is_no_noise_is_said(
    beam: surrogate.Surrogate, caplog: pytest.LogCaptureFixture
) -> None:
    """A force that is sought at the end, but acts in the middle."""
    truth = beam.solve("2.4,1:1.5,-4", correct=True)
    markers = seen(beam, truth.displacement, count=30)
    right = identify(beam, markers, ["2.4,1"], noise=NOISE)
    assert right.noise_probability > 0.01
    assert caplog.text == ""
    for noise in (NOISE, None):
        wrong = identify(beam, markers, ["4,1"], noise=noise)
        assert wrong.noise_probability < 0.01
        assert "off the state that fits them best by more than noise" in caplog.text
        caplog.clear()


def test_model_errors_widen_intervals(beam: surrogate.Surrogate) -> None:
    """Of a force by its part; of a modulus by E: hypot of both; the field is seen as before."""
    truth = beam.solve("4,1:0,-0.2", correct=True)
    markers = seen(beam, truth.displacement, count=30)
    for unknown, load, sought in (("4,1", [], -0.2), ("young-modulus", ["4,1:0,-0.2"], 500.0)):
        one = identify(beam, markers, [unknown], load)
        other = identify(beam, markers, [unknown], load, model_error=0.05)
        np.testing.assert_array_equal(one.values, other.values)
        expected = np.hypot(one.std[-1], 0.05 * abs(sought))
        assert other.std[-1] == pytest.approx(expected, rel=0.05)
        assert np.abs(other.std_displacement - one.std_displacement).max() < 2e-4


def test_a_force_where_a_pressure_acts_is_refused() -> None:
    """A group that a pressure of the case follows has no total force; the pressure is sought."""
    body = box("quad")
    end = body.coordinates[:, 0] == 2
    pressed = replace(body, groups={"end": end, "top": body.coordinates[:, 1] == 1})
    pressed = replace(pressed, pressed=pressed.loaded_body.facets_of("end"))
    none = CommandLoads(pressed.loaded_body)
    assert Unknowns.of(pressed, ["top"], none, np.empty(0)).names == ("top x", "top y")
    with pytest.raises(InputError, match="unknown: end: a pressure acts there, expected pressure:"):
        Unknowns.of(pressed, ["end"], none, np.empty(0))
    sought = Unknowns.of(pressed, ["pressure:end", "top"], none, np.empty(0))
    assert sought.names == ("top x", "top y", "pressure:end")
    with pytest.raises(InputError, match="pressure:side: expected a group of the mesh"):
        Unknowns.of(pressed, ["pressure:side"], none, np.empty(0))


def test_stiffness_and_a_force(beam: surrogate.Surrogate) -> None:
    """Young's modulus from a weight that is known, beside an unknown force."""
    truth = beam.solve("4,1:0.5,1", body_force=(0, -0.8), young_modulus=800, correct=True)
    markers = seen(beam, truth.displacement, count=30)
    found = identify(beam, markers, ["4,1", "young-modulus"], body_force=(0, -0.8))
    assert found.names[-1] == "young-modulus"
    assert found.lower[-1] < 800 < found.upper[-1]
    assert found.values[-1] == pytest.approx(800, rel=0.1)
    assert np.all(np.abs(found.values[:2] - (0.5, 1)) < 4 * found.std[:2])
    np.testing.assert_allclose(found.force.sum(axis=0), truth.force.sum(axis=0), atol=0.3)


X = np.array([[2.0, 0.5], [3.0, 0.5], [3.5, 0.2]])


@pytest.mark.parametrize(
    ("markers", "unknown", "options", "said"),
    [
        ((X, X), ["young-modulus"], {}, "expected a load that is known beside it"),
        ((X, X), [], {}, "nothing is sought"),
        ((X, X), ["4,1", "4,1"], {}, "expected each once"),
        ((X, X), ["4,0.9"], {}, "no node stands there"),
        ((X[:1], X[:1]), CORNERS, {}, "4 parameters are sought, and 2 components"),
        ((X + 5, X), ["4,1"], {}, "is off the body"),
        ((X, np.full((3, 2), np.nan)), ["4,1"], {}, "none is seen"),
        ((np.full((3, 2), np.nan), X), ["4,1"], {}, "expected finite positions"),
        ((X, X[:2]), ["4,1"], {}, "expected (m, d) twice"),
        ((np.ones((3, 3)), np.ones((3, 3))), ["4,1"], {}, "3 coordinates, expected 2"),
        ((X, X), ["4,1"], {"noise": -1.0}, "noise: -1.0, expected more than 0 m"),
        ((X, X), ["somewhere,0"], {}, "somewhere,0: expected somewhere,R with R > 0 m"),
        (
            (X, X),
            ["somewhere,1e-6"],
            {},
            "lies within 0.001 mm of a node, expected a larger radius",
        ),
        ((X, X), ["somewhere", "somewhere,1"], {}, "expected one force somewhere"),
        ((X[:1], X[:1]), ["somewhere,any"], {}, "3 parameters are sought, and 2 components"),
        ((X, X), ["4,1"], {"model_error": 1.0}, "model_error: 1.0, expected from 0 to less than 1"),
        ((X, X), ["4,1"], {"level": 1.0}, "level: 1.0, expected more than 0 and less than 1"),
    ],
)
def test_wrong_input(
    beam: surrogate.Surrogate, markers: Any, unknown: Any, options: Any, said: str
) -> None:
    with pytest.raises(InputError) as error:
        identify(beam, Markers.of(*markers), unknown, **options)
    assert said in str(error.value)


def test_what_markers_do_not_tell(beam: surrogate.Surrogate) -> None:
    """Two neighbouring forces cannot be told apart far away from them, by one marker twice."""
    truth = beam.solve("4,1:0,-1")
    x, at = markers_in(beam, 3, seed=0)
    same = np.repeat(x[:1], 3, axis=0)
    markers = Markers.of(same, same + at[:1] @ truth.displacement)
    with pytest.raises(WorkError, match="parts of it move them alike"):
        identify(beam, markers, CORNERS)


def test_command(
    beam: surrogate.Surrogate, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = beam.solve("4,1:1,-2", correct=True)
    x, at = markers_in(beam, 10, seed=3)
    y = x + at @ truth.displacement
    lines = [",".join(map(str, (*a, *b))) for a, b in zip(x, y, strict=True)]
    lines[4] = f"{x[4, 0]},{x[4, 1]},,"  # not seen
    path, out = tmp_path / "markers.csv", tmp_path / "found.npz"
    path.write_text("\n".join(["X,Y,x,y", "# by a camera", *lines]))
    words = ["identify", "beam2d_any", "--unknown", "4,1", "--out", str(out)]
    assert main([*words, "--markers", str(path)]) == 0
    assert "4,1 y: -2 N (-2" in capsys.readouterr().out
    assert main([*words, "--markers", str(path), "--model-error", "5%"]) == 0
    low, high = re.findall(r"4,1 y: -2 N \((.*) to (.*)\)", capsys.readouterr().out)[0]
    assert float(high) - float(low) > 0.2
    with np.load(out) as found:
        np.testing.assert_allclose(found["displacement"], truth.displacement, atol=1e-5)
        assert {"std", "force"} <= set(found)
    for wrong, said in (("1,2,3", "line 1: expected X,Y,x,y"), ("1,0.5,a,b", "none is seen")):
        path.write_text(wrong)
        assert main([*words, "--markers", str(path)]) == 2
        error = capsys.readouterr().err
        assert f"error: --markers '{path}': " in error
        assert said in error
    assert main([*words, "--markers", str(tmp_path / "none.csv")]) == 2
    assert f"error: --markers '{tmp_path / 'none.csv'}': " in capsys.readouterr().err
    with pytest.raises(InputError, match=r"^markers '"):
        identify(beam, tmp_path / "none.csv", ["4,1"])


def test_tensions_that_pull_a_body() -> None:
    """Those of exact markers, of both cables and a force; only actuators of the case are known."""
    body = pulled("quad", "linear")
    load = Load.of(body.geometry, ["2,0:0,-1"], actuate={"along": 9.0, "anchored": 3.0})
    series = Series(body)
    truth = body.correct(load, series.respond(load)[0]).displacement
    nodes = body.geometry.surface_nodes
    at_rest = body.geometry.coordinates[nodes]
    markers = Markers.of(at_rest, at_rest + truth[nodes])
    sought = ["actuator:along", "actuator:anchored", "2,0"]
    found = identify(series, markers, sought, confirm=True)
    assert found.names == ("2,0 x", "2,0 y", *sought[:2])
    np.testing.assert_allclose(found.values, (0, -1, 9, 3), atol=1e-3)
    assert identify(series, markers, sought).values[2] == pytest.approx(9, rel=0.01)
    assert "actuator:along: 9 N" in found.lines()[2]
    with pytest.raises(InputError, match=r"actuator:up: expected an actuator .* along, anchored"):
        identify(series, markers, ["actuator:up"])
    series.knows_forces = False
    with pytest.raises(InputError, match="the network was trained on pressures and actuators"):
        identify(series, markers, sought)
