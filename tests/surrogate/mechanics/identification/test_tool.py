"""The place of a tool from markers: without noise, with it, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.tools import Displaced, Sphere
from surrogate import Markers, identify
from surrogate.command_line import main

Array = NDArray[np.float64]
TRUE, GIVEN = Sphere((3.0, 1.2), 0.3), Sphere((3.03, 1.22), 0.3)


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.fixture(scope="module")
def truth(beam: surrogate.Surrogate) -> Any:
    return beam.solve(tool=TRUE, correct=True)


def markers(beam: surrogate.Surrogate, field: Array, noise: float = 0.0) -> Markers:
    """Every second node of the surface."""
    nodes = beam.geometry.surface_nodes[::2]
    x = beam.geometry.coordinates[nodes]
    return Markers.of(x, x + field[nodes] + np.random.default_rng(0).normal(0, noise, x.shape))


def test_a_displaced_tool() -> None:
    """A displaced sphere is a sphere elsewhere."""
    x = np.random.default_rng(0).uniform(-2, 2, (9, 2))
    one, other = Displaced(Sphere((0.5, 0.25), 0.3), (0.5, -1.0)), Sphere((1.0, -0.75), 0.3)
    for name in ("gap", "normal", "curvature"):
        np.testing.assert_allclose(getattr(one, name)(x), getattr(other, name)(x), rtol=1e-12)
    assert one.dimension == 2
    with pytest.raises(InputError, match="displaced: expected 2 or 3 components"):
        Displaced(other, (0.0, 1.0, 0.0))


def test_exact_markers(beam: surrogate.Surrogate, truth: Any) -> None:
    """The way to the true place, the field and the force of the tool."""
    found = identify(beam, markers(beam, truth.displacement), ["tool"], tool=GIVEN)
    assert found.names == ("tool x", "tool y")
    np.testing.assert_allclose(found.values, (-0.03, -0.02), atol=1e-3)
    np.testing.assert_allclose(found.displacement, truth.displacement, atol=1e-3)
    np.testing.assert_allclose(found.force.sum(axis=0), truth.contact.reaction, rtol=0.02)
    assert "tool y: -0.0" in repr(found)
    assert " m (" in repr(found)


def test_markers_with_noise(beam: surrogate.Surrogate, truth: Any) -> None:
    """Beside a weight; the interval of the depth holds it, and the field is within the noise."""
    weight, noise = (0.0, -0.05), 2e-3
    exact = beam.solve(tool=TRUE, body_force=weight, correct=True)
    seen = markers(beam, exact.displacement, noise)
    found = identify(beam, seen, ["tool"], tool=GIVEN, body_force=weight, level=0.99)
    assert found.lower[1] < -0.02 < found.upper[1]
    assert np.abs(found.displacement - exact.displacement).max() < 3 * noise
    assert 0.7 * noise < found.noise < 1.3 * noise


@pytest.mark.parametrize(
    ("unknown", "options", "said"),
    [
        (["tool"], {}, "expected 'tool' alone, and a tool"),
        (["tool", "4,1"], {"tool": GIVEN}, "expected 'tool' alone"),
        (["4,1"], {"tool": GIVEN}, "expected 'tool' alone"),
        (["tool"], {"tool": GIVEN, "confirm": True}, "confirm: expected without a tool"),
        (["tool"], {"tool": "sphere:3,3:0.3"}, "it touches nothing"),
        (["tool"], {"tool": "sphere:0,1.2:0.3"}, "overlaps nodes that are held"),
        (["tool"], {"tool": "ball:3"}, "ball"),
    ],
)
def test_refused(
    beam: surrogate.Surrogate, truth: Any, unknown: list[str], options: Any, said: str
) -> None:
    with pytest.raises(InputError) as error:
        identify(beam, markers(beam, truth.displacement), unknown, **options)
    assert said in str(error.value)


def test_command(
    beam: surrogate.Surrogate, truth: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen, path = markers(beam, truth.displacement), tmp_path / "seen.csv"
    np.savetxt(path, np.hstack([seen.at_rest, seen.seen]), delimiter=",", fmt="%.17g")
    words = ["identify", "beam2d_any", "--markers", str(path), "--unknown", "tool"]
    words += ["--tool", "sphere:3.03,1.22:0.3", "--out", str(tmp_path / "found.npz")]
    assert main(words) == 0
    assert "tool x: -0.03" in capsys.readouterr().out
