"""Actuators in modes of a body, beside its finite elements: forward, inverse, given lengths."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.actuation.actuated_body import ActuatedModes
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.actuation.bordered import Balanced, balanced, moved_by
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from tests.surrogate.mechanics.statics.test_cables import pulled

BODIES = [
    *(("quad", "linear"), ("triangle", "quadratic"), ("hexahedron", "incompressible")),
    ("tetra", "incompressible"),
]
GIVEN = {"along": 12.0, "anchored": 4.0}


@pytest.fixture(scope="module")
def model() -> Actuation:
    return fitted(pulled("quad", "linear"))


def fitted(body: Body) -> Actuation:
    return Actuation.fit(body, samples=12)


def tip(body: Body) -> tuple[str, int]:
    """The upper corner of the free end: its place as text, and its number."""
    x = body.geometry.coordinates
    number = int(np.lexsort((x[:, 1], x[:, 0]))[-1])
    return ",".join(f"{value:g}" for value in x[number]), number


@pytest.mark.parametrize(("cell_type", "element"), BODIES)
def test_modes_have_the_equilibrium_of_all_elements(cell_type: str, element: str) -> None:
    """Within 0.5 % of the largest displacement, and K of the modes is a derivative."""
    model = fitted(pulled(cell_type, element))
    found = model.at(GIVEN)
    body = model.body
    exact = body.correct(Load.of(body.geometry, actuate=GIVEN), found.displacement).displacement
    assert np.abs(found.displacement - exact).max() < 5e-3 * np.abs(exact).max()
    np.testing.assert_allclose(model.confirmed(found).displacement, exact, atol=1e-8)
    q, h = found.state.state, 1e-6
    ahead, back = (
        np.array([model.reduced.internal(q + s * h * e) for e in np.eye(len(q))]) for s in (1, -1)
    )
    tangent = model.reduced.tangent(q)
    np.testing.assert_allclose(
        tangent, ((ahead - back) / (2 * h)).T, rtol=0, atol=1e-6 * np.abs(tangent).max()
    )


def test_a_length_is_a_tension(model: Actuation) -> None:
    """The tension that a given length takes, given, leads to this length; a long cable is slack."""
    found = model.at(["along.length=1.8", "anchored=4"])
    assert found.quantities["along"] == pytest.approx(1.8, rel=1e-5)
    again = model.at({"along": found.amplitudes["along"], "anchored": 4.0})
    np.testing.assert_allclose(again.displacement, found.displacement, atol=1e-4)
    assert again.quantities["along"] == pytest.approx(1.8, rel=1e-4)
    slack = model.at(["along.length=3"])
    assert slack.amplitudes["along"] == 0
    assert slack.largest == pytest.approx(0, abs=1e-9)
    exact = model.confirmed(found)
    assert exact.quantities["along"] == pytest.approx(1.8, rel=1e-2)


@pytest.mark.parametrize("kind", ["tension", "length"])
def test_derivatives_by_what_is_given(model: Actuation, kind: str) -> None:
    values = {"tension": 12.0, "length": 1.8}
    controls = list(model.actuators.given([f"along.{kind}={values[kind]}", "anchored=4"]))
    body = ActuatedModes(model.reduced, np.zeros(len(model.reduced.modes)))
    start = Balanced(np.zeros(len(model.reduced.modes)), np.zeros(2))
    at, h = balanced(body, controls, start), 1e-5
    sides = []
    for change in (h, -h):
        controls[0] = replace(controls[0], value=values[kind] + change)
        sides.append(balanced(body, controls, at).state)
    controls[0] = replace(controls[0], value=values[kind])
    expected = (sides[0] - sides[1]) / (2 * h)
    found = moved_by(body, controls, at)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_a_target_is_reached(model: Actuation) -> None:
    """Tensions that bring the tip where given ones have brought it, and least effort otherwise."""
    place, number = tip(model.body)
    goal = model.at(GIVEN)
    x = model.body.geometry.coordinates + goal.displacement
    found = model.reach({place: x[number]}, effort=1e-5)
    assert found.missed < 1e-4
    assert found.given["along"] == pytest.approx(12, rel=1e-2)
    assert found.given["anchored"] == pytest.approx(4, rel=1e-2)
    lazy = model.reach({place: x[number]}, effort=0.3)
    assert sum(lazy.given.values()) < 0.9 * sum(found.given.values())
    assert lazy.missed > found.missed


def test_a_target_out_of_reach_leaves_the_nearest(model: Actuation) -> None:
    """No other tensions within the limits come nearer, and the limits hold."""
    place, number = tip(model.body)
    target = model.body.geometry.coordinates[number] + (0.0, 1.0)
    found = model.reach({place: target}, within={"along": (0, 15)}, effort=1e-6)
    assert found.missed > 0.1
    assert 0 <= found.given["along"] <= 15
    for along in (0.0, 5.0, 10.0, 15.0):
        for anchored in (0.0, 10.0, 20.0):
            other = model.at({"along": along, "anchored": anchored})
            x = model.body.geometry.coordinates + other.displacement
            assert np.linalg.norm(x[number] - target) >= found.missed - 1e-6


def test_modes_are_kept(model: Actuation, tmp_path: Path) -> None:
    path = tmp_path / "modes.safetensors"
    model.save(path)
    again = Actuation.read(path, model.body)
    found, expected = again.at(GIVEN), model.at(GIVEN)
    np.testing.assert_allclose(found.displacement, expected.displacement, atol=1e-12)
    with pytest.raises(InputError, match="no actuation of this body"):
        Actuation.read(path, pulled("triangle", "quadratic"))


def test_modes_are_made_anew_of_more_equilibria_alone(
    model: Actuation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file holds those of 12: for 12 or fewer it is read, for 13 they are made."""
    path = tmp_path / "modes.safetensors"
    model.save(str(path))

    def made(*_: Any, samples: int) -> Actuation:
        raise WorkError(f"{samples} are made")

    monkeypatch.setattr(Actuation, "fit", made)
    for samples in (None, 5, 12):
        again = Actuation.of_folder(tmp_path, model.body, samples=samples, file=path)
        assert again.asked == 12
    with pytest.raises(WorkError, match="13 are made"):
        Actuation.of_folder(tmp_path, model.body, samples=13, file=path)


def test_the_certificate_of_a_state_in_modes(
    model: Actuation, caplog: pytest.LogCaptureFixture
) -> None:
    """Its estimate is the distance to the equilibrium, to 1 %; limits of the case are said."""
    found = model.at(GIVEN)
    true = found.displacement - model.confirmed(found).displacement
    certificate = model.certify(found)
    assert certificate.settled
    np.testing.assert_allclose(certificate.error, true, atol=1e-2 * np.abs(true).max())
    assert not caplog.messages
    model.at({"along": 40.0})
    assert "along = 40: the limits of the case" in caplog.text


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"places": {"5,5": (0.0,)}}, "expected 2 finite numbers"),
        ({"places": {"2,1": (0.0, np.nan)}}, "expected 2 finite numbers"),
        ({"places": {}}, "expected one at least"),
        ({"places": {"2,1": (2.0, 1.0)}, "within": {"up": (0, 1)}}, "no such actuator"),
        ({"places": {"2,1": (2.0, 1.0)}, "within": {"along": (2, 1)}}, "LOW < HIGH"),
        ({"places": {"2,1": (2.0, 1.0)}, "directions": {"end": (1, 0)}}, "a group with facets"),
    ],
)
def test_wrong_targets_are_refused(model: Actuation, given: dict[str, Any], said: str) -> None:
    with pytest.raises((InputError, ValueError), match=said):
        model.reach(**given)


def test_more_than_the_body_takes_is_an_error(model: Actuation) -> None:
    with pytest.raises(WorkError, match="no equilibrium beyond"):
        model.at({"anchored": 1e7})
