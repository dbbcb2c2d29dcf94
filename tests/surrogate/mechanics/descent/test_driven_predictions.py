"""Predictions of the package's networks within a tolerance, in Python and by the command."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.mechanics.descent.driven_body import longest
from tests.surrogate.learning.inference.test_solve import FINGER_TIP

LOAD = "4,1:0,-1.5"  # at the upper right corner, in N


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.fixture(scope="module")
def forces(beam: surrogate.Surrogate) -> np.ndarray:
    """One load within the training's, and two beyond it."""
    nodal = np.zeros((3, *beam.geometry.coordinates.shape))
    nodal[:, beam.geometry.tip] = [[0.5, -1.5], [0.0, -6.0], [5.0, 9.0]]
    return nodal


@pytest.fixture(autouse=True)
def _unusual_loads() -> None:
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)


def worst(found: np.ndarray, truth: np.ndarray) -> float:
    """Largest error of a node over the largest displacement, of all loads."""
    errors = [longest(u - t) / longest(t) for u, t in zip(found, truth, strict=True)]
    return max(errors)


def test_tolerances_are_kept_load_by_load(beam: surrogate.Surrogate, forces: np.ndarray) -> None:
    truth = np.stack([beam.correct(force).displacement for force in forces])
    plain = beam.predict(forces)
    for tolerance in (1e-4, 1e-7):
        assert worst(plain, truth) > tolerance
        found = beam.predict(forces, tolerance=tolerance)
        assert worst(found, truth) < tolerance
        for force, displacement in zip(forces, found, strict=True):
            alone = beam.predict(force, tolerance=tolerance)
            np.testing.assert_allclose(alone, displacement, atol=tolerance * longest(alone))
    np.testing.assert_array_equal(beam.predict(forces), plain)
    assert beam.predict(forces[:0], tolerance=1e-3).shape == forces[:0].shape


def test_no_time_for_a_direction(beam: surrogate.Surrogate, forces: np.ndarray) -> None:
    np.testing.assert_array_equal(beam.predict(forces, budget=1e-12), beam.predict(forces))


def test_tensors(beam: surrogate.Surrogate, forces: np.ndarray) -> None:
    expected = beam.predict(forces[1], tolerance=1e-5)
    tensor = torch.from_numpy(forces[1])
    np.testing.assert_array_equal(beam.predict(tensor, tolerance=1e-5).numpy(), expected)
    with pytest.raises(InputError, match="directions have no gradients"):
        beam.predict(tensor.requires_grad_(), tolerance=1e-5)


def test_unreached_tolerance(beam: surrogate.Surrogate, forces: np.ndarray) -> None:
    """A warning names the first load; the displacements are in equilibrium."""
    message = "load 0: the tolerance is not reached after .* and 2 other loads"
    with pytest.warns(surrogate.UnreachedToleranceWarning, match=message):
        found = beam.predict(forces, tolerance=1e-30)
    truth = np.stack([beam.correct(force).displacement for force in forces])
    assert worst(found, truth) < 1e-8
    with pytest.warns(surrogate.UnreachedToleranceWarning, match="load 0: "):
        beam.predict(forces[1], tolerance=1e-5, budget=1e-12)


def test_wrong_options(beam: surrogate.Surrogate, forces: np.ndarray) -> None:
    for value in (0, -1.0, np.nan, np.inf, "1e-3"):
        with pytest.raises(InputError, match="tolerance"):
            beam.predict(forces, tolerance=value)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="budget"):
            beam.predict(forces, budget=value)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="budget"):
            beam.solve(LOAD, budget=value)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="pressure: the case has none"):
        beam.predict(forces, pressure=[1.0])
    with pytest.raises(InputError, match=r"tolerance 0\.001: expected certify"):
        beam.solve(LOAD, tolerance=1e-3, correct=True)
    with pytest.raises(InputError, match="budget 1: expected without correct"):
        beam.solve(LOAD, budget=1, correct=True)


def test_solutions(beam: surrogate.Surrogate) -> None:
    """The tolerance is relative, or in m beside a certificate."""
    plain = beam.solve(LOAD)
    assert plain.descent is None
    good = beam.solve(LOAD, tolerance=0.1)
    assert good.descent is not None
    assert (good.descent.directions, good.descent.reached, good.refusal) == (0, True, None)
    assert good.verdict is None
    better = beam.solve(LOAD, tolerance=1e-7)
    truth = beam.solve(LOAD, correct=True).displacement
    assert longest(better.displacement - truth) < 1e-7 * longest(truth)
    assert better.descent is not None
    assert better.descent.directions > 1
    assert f"{better.descent.directions} directions, estimated error" in repr(better)
    assert list(better.fields()) == ["force", "displacement", "predicted"]
    np.testing.assert_array_equal(better.predicted, plain.displacement)
    certified = beam.solve(LOAD, tolerance=1e-7, certify="full")
    assert certified.verdict == "certified"
    assert certified.descent is not None
    assert certified.descent.allowed == 1e-7
    missed = beam.solve(LOAD, tolerance=1e-30)
    assert missed.verdict is None
    assert missed.refusal is not None
    assert "not reached: the tolerance is not reached after" in repr(missed)


def test_without_spread_once_it_is_driven(trained_bayes: Path) -> None:
    """Standard deviations are those of the network's displacement."""
    model = surrogate.load(trained_bayes)
    plain = model.solve("3.5,1.5:0.5,-1", passes=5, tolerance=1e6)
    assert plain.std is not None
    driven = model.solve("3.5,1.5:0.5,-1", passes=5, tolerance=1e-6)
    assert driven.std is None
    truth = model.correct(driven.force).displacement
    assert longest(driven.displacement - truth) < 1e-6 * longest(truth)


def test_pressures() -> None:
    """The soft finger under a pressure and a force; its tip is that of `datagen solve`."""
    model = surrogate.load("finger3d")
    loads = ["notches:1000", "0.0879998235442,0,0.00794686562931:0,0.02,0"]
    solution = model.solve(loads, tolerance=1e-5, nearest=True)
    size, tip = longest(solution.displacement), model.geometry.tip
    assert solution.displacement[tip] == pytest.approx(FINGER_TIP, abs=1e-5 * size)
    found = model.predict(solution.force, tolerance=1e-5, pressure=1000.0)
    assert found[tip] == pytest.approx(FINGER_TIP, abs=1e-5 * size)
    with pytest.raises(InputError, match="pressure is missing"):
        model.predict(solution.force, tolerance=1e-5)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--tolerance", "1e-5"], 0),
        (["--budget", "10"], 0),
        (["--tolerance", "1e-5", "--budget", "100"], 0),
        (["--tolerance", "1e-7", "--certify"], 0),
        (["--tolerance", "1e-30"], 3),
        (["--tolerance", "1e-9", "--budget", "1e-12"], 3),
        (["--tolerance", "0"], 2),
        (["--tolerance", "nan"], 2),
        (["--budget=-1"], 2),
        (["--budget", "1", "--correct"], 2),
    ],
)
def test_the_command(
    tmp_path: Path, options: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "u.npz"
    command = ["predict", "beam2d_any", "--load", LOAD, "--device", "cpu", *options]
    try:
        found = main([*command, "--out", str(file)])
    except SystemExit as stop:
        found = int(str(stop.code))
    assert found == code
    assert file.is_file() == (code != 2)
    error = capsys.readouterr().err
    if code == 3:
        assert "the tolerance is not reached after" in error
    elif code == 2:
        assert options[0].split("=")[0] in error
