"""Another Young's modulus: the finite elements of that body, and what scales with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean, as_tuple
from shared_schema.tools import Sphere
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.runs.folder import RunFolder
from surrogate.mechanics.certify import Certificate, correct
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from tests.surrogate.mechanics.bodies import with_zones

LOAD, YOUNG = "4,1:0.5,-3", 1200.0  # Pa; the run has 500


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


def test_equilibrium_of_the_stiffer_body(beam: surrogate.Surrogate) -> None:
    solution = beam.solve(LOAD, body_force=(0, -0.1), young_modulus=YOUNG, stresses=True)
    material = beam.description.data.material
    assert isinstance(material, NeoHookean)
    stiffer = material.model_copy(update={"young_modulus": YOUNG})
    body = Equilibrium(beam.geometry, stiffer)
    assert solution.force.sum(axis=0) == pytest.approx((0.5, -3 - 0.4), abs=0.05)
    truth = correct(body, solution.force, solution.displacement, 1e-10).displacement
    np.testing.assert_allclose(solution.displacement, truth, atol=1e-6)
    assert solution.reaction is not None
    total = solution.reaction.sum(axis=0) + solution.force.sum(axis=0)
    assert np.abs(total).max() < 1e-4
    same = beam.solve(solution.force / 2.4, stresses=True)
    np.testing.assert_allclose(solution.displacement, same.displacement, atol=1e-12)
    for name, values in solution.stresses.items():
        factor = 1.0 if name in {"deformation_gradient", "jacobian"} else 2.4
        np.testing.assert_allclose(values, factor * same.stresses[name], rtol=1e-9, atol=1e-9)


def test_forces_of_grips_and_tools(beam: surrogate.Surrogate) -> None:
    """What is given as displacement takes forces as E."""
    for given in ({"held": {"4,1": (0, -0.4)}}, {"tool": Sphere((3, 1.2), 0.3)}):
        soft, stiff = beam.solve(**given), beam.solve(**given, young_modulus=YOUNG, correct=True)
        assert np.abs(stiff.displacement - soft.displacement).max() < 1e-4
        for name in ("grips", "contact"):
            if (one := getattr(soft, name)) is not None:
                other = getattr(stiff, name)
                one, other = getattr(one, "force", one), getattr(other, "force", other)
                np.testing.assert_allclose(other, 2.4 * one, atol=1e-3 * np.abs(other).max())


def test_refusals(beam: surrogate.Surrogate, tmp_path: Path) -> None:
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="expected more than 0 Pa, and finite"):
            beam.solve(LOAD, young_modulus=wrong)
    path = str(tmp_path / "out.npz")
    words = ["predict", "beam2d_any", "--load", LOAD, "--out", path]
    with pytest.raises(SystemExit, match="2"):
        main([*words, "--young-modulus", "-3"])
    assert main([*words, "--young-modulus", "1200"]) == 0


# --- zones --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def zoned(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """The load series of a body whose free end is of another group, with equal moduli."""
    run = RunFolder(tmp_path_factory.mktemp("zoned") / "run")
    surrogate.train({"model": "series"}, with_zones(dataset), run.folder, device="cpu")
    return run


def test_a_series_of_zones_finds_the_equilibrium(zoned: RunFolder, dataset: Dataset) -> None:
    """Ten times stiffer at the root: the finite elements' equilibrium, and an honest estimate."""
    force = 20 * dataset.nodal_test.force[0]
    model = surrogate.load(zoned.folder)
    stiff = model.with_young_moduli({"root": 5000.0})
    zones = as_tuple(stiff.description.data.material)
    assert [zone.lame_mu / zones[1].lame_mu for zone in zones] == [10, 1]
    solution = stiff.solve(force, certify="full", stresses=True)
    truth = stiff.correct(force).displacement
    error = np.linalg.norm(solution.displacement - truth, axis=1).max()
    largest = np.linalg.norm(truth, axis=1).max()
    assert error < 1e-3 * largest
    assert np.abs(model.predict(force) - truth).max() > 0.1 * largest
    assert isinstance(solution.certificate, Certificate)
    worse = 0.99 * truth
    assert stiff.certify(force, worse).max_error == pytest.approx(0.01 * largest, rel=0.05)
    estimate = stiff.fast_estimate(force[None], worse[None])[0]
    assert np.linalg.norm(estimate, axis=1).max() == pytest.approx(0.01 * largest, rel=0.5)
    assert solution.reaction is not None
    assert np.abs(solution.reaction.sum(axis=0) + force.sum(axis=0)).max() < 1e-3


def test_zones_of_equal_moduli_are_one_material(zoned: RunFolder, dataset: Dataset) -> None:
    """Twice as stiff everywhere is half of the load, to the last digits."""
    model, force = surrogate.load(zoned.folder), dataset.nodal_test.force[0]
    twice = model.with_young_moduli({"end": 1000.0, "root": 1000.0})
    np.testing.assert_allclose(twice.predict(2 * force), model.predict(force), rtol=1e-6)
    np.testing.assert_allclose(
        twice.with_young_moduli({"end": 500.0, "root": 500.0}).predict(force),
        model.predict(force),
        rtol=1e-12,
    )


@pytest.mark.parametrize(
    ("moduli", "message"),
    [
        ({"tip": 1.0}, "zone 'tip', expected one of 'root', 'end'"),
        ({"end": -1.0}, "-1.0, expected more than 0 Pa"),
    ],
)
def test_refused_zones(zoned: RunFolder, moduli: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        surrogate.load(zoned.folder).with_young_moduli(moduli)


def test_models_without_zones(
    beam: surrogate.Surrogate, zoned: RunFolder, dataset: Dataset
) -> None:
    with pytest.raises(InputError, match="one of the zones 'root', 'end'"):
        surrogate.load(zoned.folder).solve(dataset.nodal_test.force[0], young_modulus=3.0)
    with pytest.raises(InputError, match="has learned from samples of other moduli"):
        surrogate.load("beam3d_any_reduced").with_young_moduli({"end": 1.0})
    with pytest.raises(InputError, match="the body is of one material, expected one number"):
        beam.with_young_moduli({"end": 1.0})


def test_zones_on_the_command_line(
    zoned: RunFolder, dataset: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y = dataset.geometry.coordinates[-1]
    words = ["predict", str(zoned.folder), "--load", f"{x:.17g},{y:.17g}:0.1,-0.3"]
    words += ["--out", str(tmp_path / "out.npz"), "--young-modulus"]
    assert main([*words, "end=5e3"]) == 0
    model = surrogate.load(zoned.folder).with_young_moduli({"end": 5e3})
    with np.load(tmp_path / "out.npz") as fields:
        np.testing.assert_allclose(fields["displacement"], model.predict(fields["force"]))
    assert main([*words, "tip=5e3"]) == 2
    assert "zone 'tip'" in capsys.readouterr().err
    for wrong in ("=3", "end=1,end=2", "end=x"):
        with pytest.raises(SystemExit, match="2"):
            main([*words, wrong])
