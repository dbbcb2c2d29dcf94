"""Young's moduli of zones from markers: without noise, with a force, their intervals; refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

import surrogate
from shared_schema.common.errors import InputError, WorkError
from surrogate import Markers, identify
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.mechanics.identification.responses import EquilibriumResponse
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.statics.load import given_load
from tests.surrogate.mechanics.bodies import with_zones

Array = NDArray[np.float64]
ZONES = ["young-modulus:root", "young-modulus:end"]


@pytest.fixture(scope="module")
def run(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("zones") / "run"
    surrogate.train({"model": "series"}, with_zones(dataset), folder, device="cpu")
    return folder


@pytest.fixture(scope="module")
def body(run: Path) -> surrogate.Surrogate:
    """A body of two zones, each of 500 Pa."""
    return surrogate.load(run)


def load_of(body: surrogate.Surrogate) -> str:
    """A known force at the last node."""
    return ",".join(map(repr, map(float, body.geometry.coordinates[-1]))) + ":0.6,-1.5"


def seen(body: surrogate.Surrogate, moduli: dict[str, float]) -> Markers:
    """All nodes that can move, seen in equilibrium with other moduli."""
    truth = body.with_young_moduli(moduli).solve(load_of(body), correct=True).displacement
    free = ~body.geometry.clamped
    x = body.geometry.coordinates[free]
    return Markers.of(x, x + truth[free])


def test_moduli_without_noise(body: surrogate.Surrogate) -> None:
    """Both zones under a known force, to rounding, with the field of the other body."""
    moduli = {"root": 300.0, "end": 2000.0}
    found = identify(body, seen(body, moduli), ZONES, [load_of(body)])
    assert found.names == tuple(ZONES)
    np.testing.assert_allclose(found.values, (300, 2000), rtol=1e-5)
    assert found.surrogate_error == 0
    truth = body.with_young_moduli(moduli).solve(load_of(body), correct=True)
    np.testing.assert_allclose(found.displacement, truth.displacement, atol=1e-7)
    np.testing.assert_allclose(found.force, truth.force, atol=1e-12)


def test_one_zone_and_a_force(body: surrogate.Surrogate) -> None:
    """The other zone is known, so that forces need not be."""
    place = load_of(body).partition(":")[0]
    markers = seen(body, {"end": 1200.0})
    found = identify(body, markers, [place, "young-modulus:end"])
    assert found.names == (f"{place} x", f"{place} y", "young-modulus:end")
    np.testing.assert_allclose(found.values, (0.6, -1.5, 1200), rtol=1e-4)


def test_intervals_hold_the_moduli(body: surrogate.Surrogate) -> None:
    """Intervals of 90 % of two moduli in 30 trials: 54 of 60 are expected, rarely less than 45."""
    inside, exact = 0, seen(body, {"root": 400.0, "end": 900.0})
    for seed in range(30):
        noise = np.random.default_rng(seed).normal(0, 2e-3, exact.moved.shape)
        markers = Markers.of(exact.at_rest, exact.at_rest + exact.moved + noise)
        found = identify(body, markers, ZONES, [load_of(body)])
        inside += int(((found.lower <= (400, 900)) & (found.upper >= (400, 900))).sum())
    assert inside >= 45


def test_slopes_are_those_of_differences(body: surrogate.Surrogate) -> None:
    """Central differences of equilibria by the logarithm of each modulus."""
    geometry = body.geometry
    known = given_load(geometry, load_of(body))
    unknowns = Unknowns.of(geometry, ZONES, known, np.array([500.0, 500.0]))
    one = np.ones((1, len(geometry.coordinates)))
    response = EquilibriumResponse(body, unknowns, csr_array(one), np.ones(2))
    theta = np.array([-0.3, 0.4])
    slopes = response.slopes(theta, response.field(theta))
    for number in range(2):
        step = 1e-4 * np.eye(2)[number]
        change = response.field(theta + step) - response.field(theta - step)
        np.testing.assert_allclose(
            slopes[..., number], change / 2e-4, atol=1e-5 * np.abs(slopes[..., number]).max()
        )


@pytest.mark.parametrize(
    ("unknown", "said"),
    [
        (["young-modulus:tip"], "young-modulus:tip: expected a zone, 'root', 'end'"),
        (["young-modulus:end", "somewhere"], "expected zones beside known places"),
        (["young-modulus"], "one of the zones 'root', 'end'"),
        (["young-modulus:end", "young-modulus:end"], "expected each once"),
    ],
)
def test_wrong_zones(body: surrogate.Surrogate, unknown: list[str], said: str) -> None:
    x = body.geometry.coordinates[~body.geometry.clamped]
    with pytest.raises(InputError) as error:
        identify(body, Markers.of(x, x), unknown, [load_of(body)])
    assert said in str(error.value)


def test_all_zones_and_the_force_cannot_be_told(body: surrogate.Surrogate) -> None:
    """Twice the force on a body twice as stiff looks the same."""
    place = load_of(body).partition(":")[0]
    markers = seen(body, {"end": 1200.0})
    with pytest.raises(WorkError, match="the markers do not tell all that is sought"):
        identify(body, markers, [place, *ZONES])


def test_command(
    body: surrogate.Surrogate, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    markers = seen(body, {"end": 800.0})
    path, out = tmp_path / "seen.csv", tmp_path / "found.npz"
    rows = np.hstack([markers.at_rest, markers.at_rest + markers.moved])
    np.savetxt(path, rows, delimiter=",", fmt="%.17g")
    words = ["identify", str(run), "--markers", str(path), "--unknown", "young-modulus:end"]
    assert main([*words, "--load", load_of(body), "--out", str(out)]) == 0
    assert "young-modulus:end: 800 Pa" in capsys.readouterr().out
