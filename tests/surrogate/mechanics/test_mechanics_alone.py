"""A body is predicted, certified and held without any network, run folder or training."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

import surrogate
from shared_schema.tools import Sphere
from surrogate.mechanics import Body, Load, Series, Touch, identify
from tests.end_to_end.commands import ROOT

CODE = """
import sys
from surrogate.mechanics import Body, Grip, Load, Series

body = Body.read(sys.argv[1])
series, load = Series(body), Load.of(body.geometry, "3.5,1.5:0,-2")
found = series.predict(load, tolerance=1e-3)
certificate = body.certify(load, found)
assert certificate.settled and certificate.relative_error < 1e-3
frame = Grip(series, ["3.5,0"]).move([(0.0, -0.1)])
node = (body.geometry.coordinates == (3.5, 0)).all(axis=1)
assert abs(frame.displacement[node] - (0, -0.1)).max() < 1e-4
above = ("learning", "figures", "page", "serving", "commands")
print(*(name for name in sys.modules if name.startswith(tuple(f"surrogate.{n}" for n in above))))
"""


def test_nothing_above_mechanics_is_loaded(data: Path) -> None:
    command = [sys.executable, "-c", CODE, str(data)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.split() == []


def test_a_series_predicts_pushes_and_identifies_as_a_run() -> None:
    """The body of a run that comes with the package, which is a load series."""
    model = surrogate.load("beam2d_any")
    body = Body(model.geometry, model.body.case)
    series, load = Series(body), "4,1:0,-1.5"
    expected = model.predict(Load.of(model.geometry, load).dead)
    np.testing.assert_allclose(series.predict(load), expected, atol=1e-6)
    disc = Sphere((3.0, 1.2), 0.3)
    ours, theirs = (Touch(each).move(disc).reaction for each in (series, model))
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    at_rest = model.geometry.coordinates[::7]
    markers = surrogate.Markers.of(at_rest, at_rest + expected[::7])
    found = [identify(each, markers, ["4,1"], noise=1e-6).values for each in (series, model)]
    np.testing.assert_allclose(found[0], (0.0, -1.5), atol=1e-2)
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)
