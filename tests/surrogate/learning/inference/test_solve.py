"""Solutions of single load cases in Python: what the command `surrogate predict` writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.mechanics.certify.fast_certificate import Bounds
from surrogate.mechanics.certify.full_certificate import Certificate
from surrogate.mechanics.descent.first_direction import exceeds_motion
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.statics.load import Load

FINGER_TIP = (-0.001694881208, 0.00120293664, -0.01937389141)  # in m, by datagen
PUSHED = ["notches:1000", "0.0879998235442,0,0.00794686562931:0,0.02,0"]
LOAD = "4,1:0,-1.5"  # at the upper right corner, in N
FAR = "0.088,0,0.0079:0,15,0"  # on the finger: a hundred times the forces of its training


@pytest.fixture(scope="module")
def beam() -> surrogate.Surrogate:
    return surrogate.load("beam2d_any")


@pytest.fixture(scope="module")
def finger() -> surrogate.Surrogate:
    return surrogate.load("finger3d")


@pytest.fixture(scope="module")
def corrected(finger: surrogate.Surrogate) -> surrogate.Solution:
    """The finger under a pressure and a force."""
    return finger.solve(PUSHED, correct=True, stresses=True, nearest=True)


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ([], {}),
        (["--certify"], {"certify": "full"}),
        (["--certify", "fast", "--level", "0.9"], {"certify": "fast", "level": 0.9}),
        (["--correct", "--certify"], {"certify": "full", "correct": True}),
        (["--stresses"], {"stresses": True}),
    ],
)
def test_files_are_those_of_the_command(
    beam: surrogate.Surrogate, tmp_path: Path, options: list[str], given: dict[str, Any]
) -> None:
    command = ["predict", "beam2d_any", "--load", LOAD, "--device", "cpu", *options]
    for name in ("u.npz", "u.vtu", "u.xdmf"):
        assert main([*command, "--out", str(tmp_path / name)]) == 0
        beam.solve(LOAD, **given).save(tmp_path / f"python-{name}")
    found, expected = arrays(tmp_path / "python-u.npz"), arrays(tmp_path / "u.npz")
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert (tmp_path / "python-u.vtu").read_bytes() == (tmp_path / "u.vtu").read_bytes()


def test_fields_of_a_stochastic_network(trained_bayes: Path) -> None:
    model = surrogate.load(trained_bayes)
    solution = model.solve("3.5,1.5:0.5,-1", passes=5, seed=2, stresses=True)
    expected = model.predict_distribution(solution.force, 5, 2)
    for name, values in expected.fields().items():
        np.testing.assert_array_equal(solution.fields()[name], values)
    assert solution.std is not None
    assert list(solution.fields()) == ["force", *expected.fields(), "reaction"]
    assert "largest standard deviation" in repr(solution)
    corrected = model.solve("3.5,1.5:0.5,-1", passes=5, seed=2, correct=True)
    np.testing.assert_array_equal(corrected.predicted, expected.mean)
    assert list(corrected.fields()) == ["force", "displacement", "predicted"]


def test_loads_of_all_kinds(beam: surrogate.Surrogate, tmp_path: Path) -> None:
    """The same force as text, list, array, tensor and files."""
    expected = beam.solve(LOAD)
    corner = (beam.geometry.coordinates == (4, 1)).all(axis=1)
    assert expected.force[corner].tolist() == [[0.0, -1.5]]
    expected.save(tmp_path / "f.npz")
    (tmp_path / "f.csv").write_text("4,1,0,-1.5\n")
    loads: list[Any] = [
        [LOAD],
        ["4,1:0,-1", "4,1:0,-0.5"],
        expected.force,
        expected.force.tolist(),
        torch.from_numpy(expected.force),
        tmp_path / "f.npz",
        ["4,1:0,-2", tmp_path / "f.csv", "4,1:0,2"],
    ]
    for load in loads:
        np.testing.assert_array_equal(beam.solve(load).displacement, expected.displacement)
    moved = beam.solve("4.1,1:0,-1.5", nearest=True)
    assert moved.notes == ("--load '4.1,1:0,-1.5': acts at the nearest node, 4,1, 0.1 away",)
    np.testing.assert_array_equal(moved.displacement, expected.displacement)


def test_verdicts(beam: surrogate.Surrogate) -> None:
    """The estimated error of the largest node is some 60 nm, as `surrogate predict` prints."""
    plain = beam.solve(LOAD)
    assert (plain.verdict, plain.refusal, plain.estimated_error) == (None, None, None)
    assert plain.largest == "631 mm at (4, 1) m"
    assert beam.solve(LOAD, certify="full").verdict is None
    good = beam.solve(LOAD, certify="full", tolerance=1e-4)
    assert (good.verdict, good.refusal) == ("certified", None)
    bad = beam.solve(LOAD, certify="full", tolerance=1e-8, budget=1e-12)  # no direction
    assert isinstance(bad.certificate, Certificate)
    error = f"{1e6 * bad.certificate.max_error:.3g} µm > 0.01 µm"
    assert (bad.verdict, bad.refusal) == ("not certified", f"estimated error {error}")
    assert 4e-8 < bad.certificate.max_error < 8e-8
    largest = 1e3 * np.linalg.norm(bad.displacement, axis=1).max()
    assert repr(bad).splitlines() == [
        "Solution(beam2d_any, 64 nodes)",
        "  load: 1 loaded node, resultant (0, -1.5) N",
        f"  largest displacement: {largest:.3g} mm at (4, 1) m",
        f"  {bad.summary()}",
        f"  not certified: estimated error {error}",
    ]


@pytest.mark.parametrize("how", [{}, {"certify": "full"}, {"budget": 1e-9}])
def test_out_of_balance_by_more_than_it_moves_is_not_certified(
    beam: surrogate.Surrogate, how: dict[str, Any]
) -> None:
    """1000 N pull the end of the beam of 4 m by 31.1 m, as datagen finds; 7.2 m are predicted."""
    solution = beam.solve("4,1:0,-1000", **how)
    assert solution.verdict == "not certified"
    assert str(solution.refusal).startswith("the forces are out of balance by more than the body ")
    assert solution.summary().count("estimated error") == 1
    assert "not certified: the forces are out" in repr(solution)
    certificate = solution.certificate
    error = solution.one_direction if certificate is None else certificate.error
    assert error is not None
    assert np.linalg.norm(error, axis=1).max() == pytest.approx(31.058 - 7.1994, rel=0.11)


def test_one_direction_estimates_the_error_of_a_prediction(beam: surrogate.Surrogate) -> None:
    """Under 20 N the end moves by 4.28 m, and by 4.3071 m in datagen's equilibrium."""
    solution = beam.solve("4,1:0,-20")
    assert (solution.verdict, solution.refusal) == (None, None)
    assert solution.one_direction is not None
    estimate = np.linalg.norm(solution.one_direction, axis=1).max()
    true = np.linalg.norm(
        solution.displacement - beam.solve("4,1:0,-20", correct=True).displacement, axis=1
    )
    assert true.max() == pytest.approx(0.0413, rel=0.01)
    assert true.max() < estimate < 2 * true.max()
    assert solution.summary().endswith(" mm by one direction")


def test_displacement_is_certified_neither_far_above_nor_far_below_the_true_one() -> None:
    """An error of 25 times what the body moves is as wrong as a prediction that hardly moves."""
    true = np.array([[0.0, 0.5e-3], [0.0, 0.0]])
    for predicted in (26 * true, 2.1 * true, 0.4 * true, 0 * true, np.nan * true):
        assert exceeds_motion(predicted - true, predicted)
    for predicted in (1.9 * true, true, 0.6 * true):
        assert not exceeds_motion(predicted - true, predicted)


@pytest.mark.parametrize("certify", ["full", "fast"])
def test_inverted_elements_are_never_certified(
    finger: surrogate.Surrogate,
    certify: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A network far beyond its training; a series with the least energy inverts no element."""
    solution = finger.solve(FAR, certify=certify, nearest=True)
    assert solution.verdict == "not certified"
    assert "inverted elements" in str(solution.refusal)
    out = tmp_path / "u.npz"
    options = ["--load", FAR, "--nearest", "--certify", certify, "--out", str(out)]
    assert main(["predict", "finger3d", *options]) == 3
    assert "inverted elements" in capsys.readouterr().err
    assert out.exists()


def test_unusual_loads_are_logged_and_kept(
    beam: surrogate.Surrogate, caplog: pytest.LogCaptureFixture
) -> None:
    """Each kind is logged once; the solution has all of them. A load series has no training."""
    assert beam.solve("4,1:0,-55").outside_training == ()
    caplog.clear()
    model = surrogate.load("finger3d")
    warnings = model.solve(FAR, nearest=True).outside_training
    assert warnings[0].startswith("force components reach beyond those of the training data")
    solution = model.solve(FAR, nearest=True)
    assert solution.outside_training == warnings
    assert [text for text in caplog.messages if text in warnings] == list(warnings)
    assert "warning: force components" in repr(solution)


@pytest.mark.parametrize(
    ("load", "options", "part"),
    [
        (LOAD, {"tolerance": 1e-3, "correct": True}, "tolerance 0.001: expected certify"),
        (LOAD, {"level": 0.9}, "level 0.9: expected beside certify="),
        (LOAD, {"passes": 3}, "passes 3: passes of this network do not differ"),
        (LOAD, {"conformal": "marginal"}, "no conformal intervals in the run"),
        ("4.1,1:0,-1", {}, "no node stands there"),
        ([], {}, "no load, expected"),
        (np.zeros((1, 64, 2)), {}, r"forces have shape \(1, 64, 2\), expected \(64, 2\)"),
        (np.ones((64, 2)), {}, "forces at node 0: the node is clamped"),
    ],
)
def test_wrong_input(
    beam: surrogate.Surrogate, load: Any, options: dict[str, Any], part: str
) -> None:
    with pytest.raises(InputError, match=part):
        beam.solve(load, **options)


def test_a_network_without_a_folder_has_no_calibration(
    make_run: Callable[..., Path], trained: Path
) -> None:
    model = surrogate.load(trained)
    model.folder = None
    with pytest.raises(InputError, match="not loaded from a run folder"):
        model.solve("3.5,1.5:0.5,-1", certify="fast")


@pytest.mark.parametrize("name", ["beam2d_any", "finger3d"])
def test_plot(name: str, request: pytest.FixtureRequest) -> None:
    """Colours are the estimated errors of a certified solution, else the displacements."""
    model = request.getfixturevalue({"beam2d_any": "beam", "finger3d": "finger"}[name])
    force = np.zeros(model.geometry.coordinates.shape)
    force[model.geometry.tip, -1] = -0.01
    figure = model.solve(force).plot()
    assert figure.axes[1].get_ylabel() == r"displacement $\|u\|_2$ [mm]"
    if name == "beam2d_any":
        figure = model.solve(force, certify="full").plot()
        assert figure.axes[1].get_ylabel() == "estimated error of a node [nm]"


def test_pressure_is_certified_and_corrected(
    beam: surrogate.Surrogate, finger: surrogate.Surrogate, corrected: surrogate.Solution
) -> None:
    """The soft finger under a pressure and a force beside `datagen solve` of the same load.

    The estimate is exact within a thousandth of the error of the network, which is 0.03 mm or more.
    """
    model = finger
    certified = model.solve(PUSHED, certify="full", nearest=True)
    assert corrected.correction is not None
    found = corrected.displacement
    tip = found[model.geometry.tip]
    assert tip == pytest.approx(FINGER_TIP, rel=1e-6)
    wrong = certified.displacement - found
    assert 3e-5 < np.linalg.norm(wrong, axis=1).max() < 1e-3
    assert certified.estimated_error == pytest.approx(wrong, abs=1e-3 * np.abs(wrong).max())
    forces = certified.force
    by_array = model.correct(forces, pressure=1000)
    assert by_array.displacement == pytest.approx(found, abs=1e-9)
    two = model.certify(np.stack([forces] * 2), np.stack([found] * 2), pressure=[[1000], [990]])
    assert two.max_error[0] < 1e-9 < 1e-5 < two.max_error[1]
    with pytest.raises(InputError, match="pressure is missing"):
        model.certify(forces)
    with pytest.raises(InputError, match=r"pressure has shape \(2,\), expected 1 finite number"):
        model.correct(forces, pressure=[1, 2])
    with pytest.raises(InputError, match="the case has none"):
        beam.certify(np.zeros_like(beam.geometry.coordinates), pressure=1)
    assert corrected.reaction is not None
    pushed = model.body.equilibrium.under(_pressure(model, 1000)).following
    assert pushed is not None
    balance = corrected.reaction + pushed.forces(found[None])[0]
    assert balance.sum(axis=0) == pytest.approx([0, -0.02, 0], abs=1e-9)


def _pressure(model: surrogate.Surrogate, pressure: float) -> FollowingLoads:
    return FollowingLoads.of(model.geometry, np.array([[pressure]]))


def test_fast_bounds_under_pressure(
    finger: surrogate.Surrogate, corrected: surrogate.Solution
) -> None:
    """Of loads and of arrays, and not beyond the pressures of the calibration."""
    model = finger
    found = model.solve("notches:1000", certify="fast")
    assert isinstance(found.certificate, Bounds)
    assert found.certificate.reasons == (None,)
    forces = found.force
    truth = model.correct(forces, corrected.displacement, pressure=1000).displacement
    error = truth - found.displacement
    assert np.linalg.norm(error, axis=1).max() <= found.certificate.largest
    assert np.abs(error).mean() <= found.certificate.mean
    by_array = model.bounds(forces, pressure=1000)
    assert by_array.reasons == (None,)
    assert by_array.largest == pytest.approx(found.certificate.largest, rel=1e-2)
    (reason,) = model.bounds(1.6 * forces, pressure=1600).reasons
    assert reason is not None
    assert "pressure 1600 Pa, 0 to 1498 there" in reason
    with pytest.raises(InputError, match="pressure is missing"):
        model.bounds(forces)


def test_pressures_of_samples_are_told_from_their_forces(finger: surrogate.Surrogate) -> None:
    """In single precision, as a dataset has their sum; a force everywhere hides the pressure."""
    body = finger.geometry
    pressure = FollowingLoads.of(body, np.array([[1000.0], [0], [20]]))
    dead = np.zeros((3, *body.coordinates.shape))
    dead[:2, body.surfaces[0][5, 0]] = 0.1, -0.02, 0.05
    total = ((dead + pressure.at_rest) * body.free).astype(np.float32).astype(np.float64)
    found, pressures = (both := Load.of_samples(body, total)).dead, both.following
    assert pressures is not None
    assert pressures.amplitudes == pytest.approx(pressure.amplitudes, rel=1e-6)
    np.testing.assert_allclose(found, dead, atol=1e-8)
    assert np.array_equal(found.any(axis=2), dead.any(axis=2))
    with pytest.raises(InputError, match="cannot be told from their other forces"):
        Load.of_samples(body, total + 0.01 * body.free)


def test_pressure_of_a_network_needs_directions(finger: surrogate.Surrogate) -> None:
    with pytest.raises(InputError, match="pressure: expected beside a tolerance"):
        finger.predict(np.zeros_like(finger.geometry.coordinates), pressure=[1.0])
