"""Conformal intervals of a run, fitted to its calibration split."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.calibration import HeldOut, fit_intervals, fit_on_samples
from surrogate.learning.inference.loading import load
from surrogate.learning.runs.split import split_training
from surrogate.mechanics.certify.conformal import Intervals

LIKELIHOODS = ["deterministic", "maximum_likelihood", "variational_bayes"]


@pytest.fixture(scope="module", params=LIKELIHOODS)
def run(request: pytest.FixtureRequest, make_run: Callable[..., Path]) -> Path:
    """A run that keeps 12 of 48 samples for calibration."""
    return make_run(likelihood=request.param, epochs=8, calibration_fraction=0.25)


@pytest.fixture(scope="module")
def content(run: Path, data: Path) -> dict[str, Any]:
    evaluation = evaluate(run, data, passes=10, conformal=0.9)
    evaluation.write()
    return evaluation.content


def test_scores_of_the_calibration_split(run: Path, data: Path, content: dict[str, Any]) -> None:
    """⌈13 · 0.9⌉ = 12: with 12 samples the factors are their largest scores."""
    assert (content["conformal"]["level"], content["conformal"]["samples"]) == (0.9, 12)
    surrogate, dataset = load(run), read_dataset(data)
    intervals = Intervals.read(run / "intervals.safetensors")
    again = fit_intervals(surrogate, dataset, 0.9, passes=10, seed=0)
    for kind, calibration in again.calibrations.items():
        np.testing.assert_allclose(intervals.calibrations[kind].factor, calibration.factor)
    rows = split_training(dataset.train, surrogate.description.run).calibration_rows
    samples = dataset.nodal_train(rows)
    predicted = surrogate.averaged_passes(samples.force, 10)
    std = predicted.std if surrogate.is_probabilistic else np.ones_like(predicted.mean)
    free = ~surrogate.geometry.clamped
    scores = np.abs(samples.displacement - predicted.mean)[:, free] / std[:, free]
    np.testing.assert_allclose(
        intervals.calibrations["marginal"].factor[free], scores.max(axis=0), rtol=1e-6
    )
    np.testing.assert_allclose(
        intervals.calibrations["simultaneous"].factor[free], scores.max(), rtol=1e-6
    )


def test_coverage_of_the_test_split(content: dict[str, Any]) -> None:
    """Simultaneous intervals are wider than marginal ones.

    With 12 test samples the share of components covered has a standard deviation below
    √(0.9 · 0.1 · (1/12 + 1/14)) = 0.12.
    """
    marginal, simultaneous = (content["conformal"][k] for k in ("marginal", "simultaneous"))
    assert simultaneous["width"] > marginal["width"] > 0
    assert marginal["coverage"] > 0.9 - 3 * 0.12
    assert simultaneous["coverage"] in [k / 12 for k in range(13)]


def test_predict_writes_the_ends(tmp_path: Path, run: Path, content: dict[str, Any]) -> None:
    out = tmp_path / "field.npz"
    arguments = ["predict", str(run), "--load", "3.5,1.5:0,-1", "--out", str(out)]
    assert main([*arguments, "--conformal", "marginal"]) == 3  # displacements are made up
    fields = np.load(out)
    surrogate = load(run)
    intervals = Intervals.read(run / "intervals.safetensors")
    predicted = surrogate.averaged_passes(fields["force"])
    lower, upper = intervals.bounds("marginal", predicted.mean, surrogate.score_scale(predicted))
    np.testing.assert_allclose(fields["lower"], lower)
    np.testing.assert_allclose(fields["upper"], upper)
    assert (fields["lower"] <= fields["displacement"]).all()


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    return capsys.readouterr().err


def test_refusals(
    tmp_path: Path,
    data: Path,
    evaluated: Path,
    run: Path,
    make_dataset: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(evaluated, copy)
    message = refusal(capsys, "evaluate", str(copy), "--data", str(data), "--conformal", "0.9")
    assert "'training.calibration_fraction' = 0.0, expected above 0" in message
    load_case = ["--load", "3.5,1.5:0,-1", "--out", str(tmp_path / "f.npz")]
    message = refusal(capsys, "predict", str(copy), *load_case, "--conformal", "marginal")
    assert "no conformal intervals in the run" in message
    shutil.copytree(run, tmp_path / "run")
    run = tmp_path / "run"
    before = sorted((path, path.stat().st_mtime_ns) for path in run.rglob("*"))
    for level, expected in (
        ("0.95", "12 calibration samples, expected at least 19"),
        ("1.5", "1.5"),
    ):
        message = refusal(capsys, "evaluate", str(run), "--data", str(data), "--conformal", level)
        assert f"--conformal {level}" in message
        assert expected in message
    other = make_dataset(tmp_path / "other", seed=5)
    message = refusal(capsys, "evaluate", str(run), "--data", str(other), "--conformal", "0.9")
    assert "not the dataset that the run was trained on" in message
    assert sorted((path, path.stat().st_mtime_ns) for path in run.rglob("*")) == before


def test_nodal_samples_of_the_training_split(dataset: Dataset) -> None:
    """On a grid whose points are nodes they are the grid's."""
    rows = torch.tensor([3, 0])
    nodal = dataset.nodal_train(rows)
    np.testing.assert_array_equal(
        dataset.geometry.grid.to_grid(nodal.displacement).astype(np.float32),
        dataset.train.displacement[rows].numpy(),
    )


def test_corrections_take_the_place_of_a_dataset(run: Path, data: Path) -> None:
    """They are equilibria, within the tolerance of 1e-8 N of the corrections."""
    surrogate, dataset = load(run), read_dataset(data)
    rows = split_training(dataset.training, surrogate.description.run).calibration_rows
    forces = dataset.nodal_train(rows).force
    samples = HeldOut.corrected(surrogate, forces, 10, 0)
    assert 0 < len(samples.force) <= len(forces)
    residual = surrogate.body.equilibrium.out_of_balance(samples.truth, samples.force)
    assert np.abs(residual).max() <= 1e-8
    fast = fit_on_samples(surrogate, samples)
    assert len(fast.ratios["mean"]) == len(samples.force)
    assert fast.knows_components == surrogate.is_probabilistic


def test_unstable_predictions_are_not_corrected() -> None:
    """A force of 60 N along the beam's axis is far beyond its buckling load of 8 N."""
    surrogate = load("beam2d_any")
    forces = np.zeros((2, *surrogate.geometry.coordinates.shape))
    end = np.flatnonzero(surrogate.geometry.coordinates[:, 0] == 4)
    forces[0, end, 0], forces[1, end[0], 1] = -60 / len(end), 0.5
    samples = HeldOut.corrected(surrogate, forces, 1, 0)
    np.testing.assert_array_equal(samples.force, forces[1:])
