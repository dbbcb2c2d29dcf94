"""Predictions without a fast bound: unstable states, and loads unlike those of the calibration."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import surrogate
from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import SHELF
from surrogate.mechanics.certify.calibrated_range import LEAST_STIFFNESS, CalibratedRange
from surrogate.mechanics.certify.fast_certificate import NO_RANGE, FastCertificate, read_calibration
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.descent import DrivenBody
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.runtime.tensor_file import load_tensors, serialised
from tests.surrogate.mechanics.bodies import MATERIAL, box

END = [f"4,{y}:-5,0" for y in ("0", "0.3333333333333333", "0.6666666666666666", "1")]
UNSTABLE = "the predicted state is unstable, its stiffness is not positive definite"


@pytest.fixture(scope="module")
def beam() -> Surrogate:
    return surrogate.load("beam2d_any")


def at_end(model: Surrogate, *forces: tuple[float, ...]) -> np.ndarray:
    """Forces at the nodes of the end, from one edge to the other, (n_nodes, d) in N."""
    x = model.geometry.coordinates
    end = np.flatnonzero(x[:, 0] == x[:, 0].max())
    load = np.zeros_like(x)
    load[end[np.argsort(x[end, 1])][: len(forces)]] = forces
    return load


@pytest.mark.parametrize("cell_type", ["quad", "hexahedron"])
def test_ritz_value_of_compressed_beams(cell_type: str) -> None:
    """States u = −ε x along the axis, from rest to the other side of the buckling load.

    In the plane P is nearly K(0)⁻¹ here: θ is the smallest eigenvalue of K(0)⁻¹ K(u) to 0.01, where
    it is positive. Everywhere its sign is the verdict of Cholesky's factorisation.
    """
    body = box(cell_type)
    x, equilibrium = body.coordinates, Equilibrium(body, MATERIAL)
    fast = FastEstimate(DrivenBody.of(equilibrium))
    free = np.flatnonzero(equilibrium.free.ravel())
    stiffness = []
    strains = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2)
    u = np.zeros((len(strains), *x.shape))
    u[:, :, 0] = -np.array(strains)[:, None] * x[:, 0]
    for state in u:
        columns = np.zeros((len(free), x.size))
        columns[np.arange(len(free)), free] = 1e-6
        steps = columns.reshape(-1, *x.shape)
        change = equilibrium.out_of_balance(state + steps, 0 * steps)
        change -= equilibrium.out_of_balance(state - steps, 0 * steps)
        stiffness.append(change.reshape(len(free), -1)[:, free] / 2e-6)
    factor = np.linalg.cholesky(np.linalg.inv(stiffness[0]))
    exact = np.array([np.linalg.eigvalsh(factor.T @ k @ factor)[0] for k in stiffness])
    assert exact[0] == pytest.approx(1, abs=1e-6)
    assert exact[-1] < 0
    _, _, softest = fast.with_stability(np.zeros_like(u), u)
    definite = np.array([equilibrium.response_at(state) is not None for state in u])
    assert ((softest > 0) == definite).all()
    assert 0 < definite.sum() < len(u)
    if cell_type == "quad":
        assert np.abs(softest - exact)[definite].max() < 0.01


def test_a_symmetric_residual_does_not_see_buckling(
    beam: Surrogate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Straight beam under 20 N, exactly symmetric: conjugate gradients from r find it stiff."""
    force = np.stack([at_end(beam, *[(-5.0, 0.0)] * 4)] * 2)
    x, predicted = beam.geometry.coordinates, beam.predict(force)
    mirrored = np.linalg.norm(x[:, None] * (1, -1) + (0, 1) - x, axis=2).argmin(axis=1)
    straight = (predicted + predicted[:, mirrored] * (1, -1)) / 2
    _, _, softest = beam.fast_estimate.with_stability(force, straight)
    assert softest[0] < 0
    assert beam.body.equilibrium.response_at(straight[0]) is None
    monkeypatch.setattr(DrivenBody, "softest", lambda *state: 1.0)
    _, _, of_residual = beam.fast_estimate.with_stability(force, straight)
    assert of_residual[0] > 0.5


def test_axial_forces_are_not_certified(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Four forces of −5 N along the axis: the prediction stays straight, the beam buckles."""
    loads = [text for load in END for text in ("--load", load)]
    out = tmp_path / "u.npz"
    for options in ((), ("--tolerance", "1e9"), ("--level", "0.5")):
        command = ["predict", "beam2d_any", *loads, "--certify", "fast", *options]
        assert main([*command, "--nearest", "--out", str(out)]) == 3
        captured = capsys.readouterr()
        assert captured.out.endswith(", no bound of the error, not certified\n")
        assert captured.err.endswith(f"surrogate: not certified: {UNSTABLE}\n")


def test_refusals(beam: Surrogate) -> None:
    """Each in turn, from Python; the calibration of `beam2d_any` has forces up to 2 N."""
    free = np.flatnonzero(beam.geometry.loadable)
    many = np.zeros_like(beam.geometry.coordinates)
    many[free[:5], 1] = 0.01
    loads = {
        "": at_end(beam, (0.5, -1.5)),
        UNSTABLE: at_end(beam, *[(-5.0, 0.0)] * 4),
        "near an instability: smallest stiffness 0.18 of that at rest, the calibration": at_end(
            beam, *[(-1.8, 0.0)] * 4
        ),
        "unlike the calibration of the bounds: number of loaded nodes 5, 1 to 4 there": many,
        "unlike the calibration of the bounds: force components at a node up to": at_end(
            beam, (0.0, -2.5)
        ),
        "unlike the calibration of the bounds: resultant up to": at_end(beam, *[(1.9, 0.0)] * 4),
    }
    forces = np.stack(list(loads.values()))
    bounds = beam.bounds(forces)
    for number, part in enumerate(loads):
        reason = bounds.reasons[number]
        assert (reason or "").startswith(part)
        assert (reason is None) == (part == "")
        assert np.isfinite([bounds.mean[number], bounds.largest[number]]).all() == (part == "")
    assert bounds.certified(1e9).tolist() == [True, *[False] * 5]
    assert bounds.summary() == "6 predictions with bounds of probability 0.95, 5 without"
    assert bounds.refusal(1e9) == f"prediction 1: {UNSTABLE}"
    assert bounds.refusal(0.0).startswith("prediction 0: bound of the error")  # type: ignore[union-attr]


def test_wrong_predictions_are_unlike_the_calibration(beam: Surrogate) -> None:
    """The whole body moves by 1 mm more; or so far that its displacement is unusual."""
    force = at_end(beam, (0.5, -1.5))
    good = beam.predict(force)
    assert beam.bounds(force, good).refusal(1e-3) is None
    wrong = good + 0.01 * beam.geometry.coordinates[:, :1]
    assert "estimated error" in str(beam.bounds(force, wrong).reasons[0])
    known = beam.fast_certificate.calibrated
    assert known is not None
    far = (2 * known.displacement * np.ones_like(good))[None]
    like = force[None], far, np.zeros_like(far), np.ones(1)
    reason = known.refusals(*like, beam.geometry.loadable)[0]
    assert reason is not None
    assert "displacement" in reason
    nowhere = np.zeros_like(beam.geometry.loadable)
    at_rest = force[None], good[None], np.zeros_like(far), np.ones(1)
    assert "never loaded" in str(known.refusals(*at_rest, nowhere)[0])


def test_batches_are_singles(beam: Surrogate) -> None:
    forces = np.stack([at_end(beam, (0.5, -k)) for k in (0.5, 1.0, 3.0)])
    predicted = beam.predict(forces)
    together = beam.bounds(forces, predicted, level=0.9)
    for number, force in enumerate(forces):
        alone = beam.bounds(force, predicted[number], level=0.9)
        assert alone.error == pytest.approx(together.error[number], abs=1e-12)
        assert float(alone.mean) == pytest.approx(together.mean[number])
        assert float(alone.largest) == pytest.approx(together.largest[number])
        assert alone.reasons == (together.reasons[number],)
    with pytest.raises(InputError, match=r"level 0\.9999: 400 calibration samples"):
        beam.bounds(forces, level=0.9999)
    assert beam.bounds(forces[:0]).reasons == ()


def test_corrections_of_many_loads(beam: Surrogate) -> None:
    forces = np.stack([at_end(beam, (0.5, -k)) for k in (0.5, 1.0)])
    for number, found in enumerate(beam.correct_each(forces)):
        alone = beam.correct(forces[number]).displacement
        assert found.displacement == pytest.approx(alone, abs=1e-9)
    with pytest.raises(InputError, match=r"expected \('N', 64, 2\)"):
        beam.correct_each(forces[0])


def test_bounds_of_a_correction(beam: Surrogate) -> None:
    """They are those of the equilibrium, which the solution shows: near rounding errors."""
    force = at_end(beam, (0.5, -1.5))
    plain = beam.solve(force, certify="fast", tolerance=1e-2)
    both = beam.solve(force, certify="fast", correct=True, tolerance=1e-2)
    assert (plain.verdict, both.verdict) == ("certified", "certified")
    assert plain.estimated_error is not None
    assert both.estimated_error is not None
    assert 0 < np.abs(both.estimated_error).max() < 1e-3 * np.abs(plain.estimated_error).max()
    assert "corrected in" in both.summary()
    assert "at any node, each with probability 0.95" in both.summary()


def test_calibrations_of_an_earlier_version_bound_nothing(tmp_path: Path) -> None:
    """Their file has ratios only."""
    folder = tmp_path / "run"
    shutil.copytree(SHELF / "beam2d_any", folder)
    run = RunFolder(folder)
    ratios = load_tensors(run.fast_certificate)[0]
    ratios = {
        name: values.clone() for name, values in ratios.items() if name in ("mean", "largest")
    }
    run.fast_certificate.unlink()
    run.fast_certificate.write_bytes(serialised(ratios, {"estimate": "conjugate gradients"}))
    run.seal.add([run.fast_certificate])
    model = surrogate.load(folder)
    solution = model.solve("4,1:0,-1.5", certify="fast")
    assert (solution.verdict, solution.refusal) == ("not certified", NO_RANGE)


def test_file_keeps_the_range(beam: Surrogate, tmp_path: Path) -> None:
    fast, path = beam.fast_certificate, tmp_path / "fast.safetensors"
    path.write_bytes(fast.serialised())
    ratios, known = read_calibration(path)
    assert fast.calibrated is not None
    assert known is not None
    assert known.softest == fast.calibrated.softest > LEAST_STIFFNESS
    assert (known.fewest, known.most) == (1, 4)
    assert known.force.tolist() == fast.calibrated.force.tolist()
    assert ratios["mean"].tolist() == np.sort(fast.ratios["mean"]).tolist()
    tensors = {name: values.clone() for name, values in load_tensors(path)[0].items()}
    del tensors["range_of_softest"]
    path.unlink()
    path.write_bytes(serialised(tensors, {"estimate": "conjugate gradients"}))
    with pytest.raises(InputError, match="not a fast certificate"):
        read_calibration(path)


def test_unstable_samples_calibrate_nothing(beam: Surrogate) -> None:
    """They are left out of the ratios and of the range."""
    forces = np.stack([at_end(beam, (0.5, -1.0)), at_end(beam, *[(-5.0, 0.0)] * 4)])
    predicted = beam.predict(forces)
    fast = FastCertificate.fit(beam.fast_estimate, forces, predicted, predicted + 1e-6)
    assert len(fast.ratios["mean"]) == 1
    assert fast.calibrated is not None
    assert fast.calibrated.resultant.tolist() == [0.5, 1.0]
    none = CalibratedRange.of(forces[:0], predicted[:0], predicted[:0], np.zeros(0))
    assert (none.displacement, none.most) == (0.0, 0)
