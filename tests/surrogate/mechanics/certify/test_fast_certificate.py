"""Bounds of made-up errors of very different sizes on a small body, and those of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from shared_schema.common.errors import InputError
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.loading import load
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.split import split_training
from surrogate.mechanics.certify.calibrated_range import CalibratedRange
from surrogate.mechanics.certify.conformal import conformal_quantile
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.certify.fast_certificate import (
    FastCertificate,
    read_calibration,
    sizes,
    with_rest,
)
from surrogate.mechanics.certify.fast_estimate import FastEstimate
from surrogate.mechanics.descent import DrivenBody
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.runtime.tensor_file import load_tensors, serialised
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load


@pytest.fixture(scope="module")
def estimate() -> FastEstimate:
    return FastEstimate(DrivenBody.of(Equilibrium(box("quad"), MATERIAL)))


def test_coverage_on_new_samples(estimate: FastEstimate) -> None:
    """Errors from 1e-5 to 1e-2 m; q covers 90 % within three standard deviations, bounds more."""
    equilibrium = Equilibrium(box("quad"), MATERIAL)
    rng, n = np.random.default_rng(0), 400
    force = end_load(box("quad"), 1.0, 1.0)[None] * rng.uniform(-3, 3, (n, 1, 2))
    truth = np.stack([correct(equilibrium, f, 0 * f).displacement for f in force])
    x = box("quad").coordinates[None] / 2
    size = 10 ** rng.uniform(-5, -2, (n, 1, 1))
    shape = x[..., :1] ** 2 * rng.normal(size=(n, 1, 2)) + x[..., :1] * rng.normal(size=(n, 1, 2))
    predicted = truth + size * shape
    half = n // 2
    fitted = FastCertificate.fit(estimate, force[:half], predicted[:half], truth[:half])
    bounds = fitted.bounds(*estimate.with_stability(force[half:], predicted[half:]), 0.9)
    true = sizes((predicted - truth)[half:])
    for name in ("mean", "largest"):
        ratios = true[name] / (bounds[name] / fitted.factor(0.9, name))
        covered = (ratios <= conformal_quantile(fitted.ratios[name], 0.9)).mean()
        assert abs(covered - 0.9) < 3 * np.sqrt(2 * 0.9 * 0.1 / half)
        assert (true[name] <= bounds[name]).mean() >= covered
        assert np.median(bounds[name] / true[name]) < 2.1  # as wide as each load needs
        assert bounds[name].max() / bounds[name].min() > 100
    measured = fitted.measures(force[half:], predicted[half:], truth[half:])
    assert measured["samples"] == half
    assert measured["mean"][0] == {
        "level": 0.9,
        "coverage": pytest.approx((true["mean"] <= bounds["mean"]).mean()),
        "median_width": pytest.approx(np.median(bounds["mean"] / true["mean"])),
    }


def test_intervals_of_the_size_of_each_error(estimate: FastEstimate) -> None:
    """σ of the right shape and one size for all loads, whose errors are from 1e-5 to 1e-3 m.

    Intervals with the estimate's size hold their share under loads with small and large errors.
    """
    equilibrium, rng, n = Equilibrium(box("quad"), MATERIAL), np.random.default_rng(0), 300
    force = end_load(box("quad"), 1.0, 1.0)[None] * rng.uniform(-3, 3, (n, 1, 2))
    truth = np.stack([correct(equilibrium, f, 0 * f).displacement for f in force])
    x = box("quad").coordinates[None, :, :1] / 2
    std = np.broadcast_to(1e-4 * x**2, truth.shape)
    size = 10 ** rng.uniform(-1, 1, n)
    smooth = rng.normal(size=(n, 1, 2)) + x * rng.normal(size=(n, 1, 2))
    predicted = truth + size[:, None, None] * std * smooth
    some, others = slice(0, n // 2), slice(n // 2, n)
    fast = FastCertificate.fit(estimate, force[some], predicted[some], truth[some], std[some])
    assert fast.knows_components
    new = force[others], predicted[others], truth[others], std[others]
    for level in (0.5, 0.95):
        inside = fast.inside(*new, level)[:, std[0].any(axis=1)].mean(axis=(1, 2))
        small = size[others] < 1
        for group in (small, ~small):
            tolerance = 3 * inside[group].std() / np.sqrt(group.sum()) + 0.02
            assert abs(inside[group].mean() - level) < tolerance
    measured = fast.measures(*new)["component"]
    assert [entry["level"] for entry in measured] == [0.9, 0.95]
    assert measured[1]["coverage"] == pytest.approx(inside.mean())
    half = fast.half_widths(estimate(*new[:2]), std[others], 0.95)
    assert half.max() / half[half > 0].min() > 1e3
    assert not half[:, x[0, :, 0] == 0].any()


def test_inverted_predictions_have_no_bound(estimate: FastEstimate) -> None:
    force = np.stack([end_load(box("quad"), 1.0, 1.0)] * 2)
    predicted = np.zeros_like(force)
    predicted[0, -1, 0] = -0.9
    ratios = {name: np.ones(10) for name in ("mean", "largest")}
    error, _, softest = estimate.with_stability(force[1:], predicted[1:])
    like = CalibratedRange.of(force[1:], predicted[1:], error, softest)
    fast = FastCertificate(estimate, ratios, like)
    bounds = fast.bounds(*estimate.with_stability(force, predicted), 0.9)
    assert bounds["mean"][0] == bounds["largest"][0] == np.inf
    assert 0 < bounds["mean"][1] < bounds["largest"][1] < 1
    alone = fast.certify(force[0], predicted[0], 0.9)
    assert alone.refusal(1.0) == alone.refusal(np.inf) == "inverted elements"
    assert alone.largest == np.inf
    assert not alone.certified(np.inf)


def test_bounds_are_no_smaller_than_the_estimate(estimate: FastEstimate) -> None:
    """Samples whose errors are half of their estimates leave bounds of 2 times these."""
    ratios = {"mean": np.full(40, 0.5), "largest": np.linspace(0.5, 4.0, 40)}
    fast = FastCertificate(estimate, ratios)
    assert fast.factor(0.9) == 2.0
    assert fast.factor(0.9, "largest") == np.sort(ratios["largest"])[36]  # ⌈41 · 0.9⌉ = 37


def test_too_few_samples(estimate: FastEstimate) -> None:
    zeros = np.zeros((5, 28, 2))
    fast = FastCertificate.fit(estimate, zeros, zeros, zeros)
    with pytest.raises(ValueError, match="5 calibration samples, expected at least 9"):
        fast.factor(0.9)
    measured = fast.measures(zeros, zeros, zeros)
    assert measured == {"samples": 5, "refused": 0, "mean": [], "largest": []}


def test_run_keeps_its_calibration(make_run: Callable[..., Path], data: Path) -> None:
    """12 calibration and 5 validation samples of 48: the 90 % quantile is the 17th ratio."""
    folder = make_run(epochs=8, calibration_fraction=0.25)
    run, surrogate, dataset = RunFolder(folder), load(folder), read_dataset(data)
    with pytest.raises(InputError, match="no fast certificate in the run"):
        surrogate.fast_certificate  # noqa: B018
    evaluation = evaluate(folder, data, certify=True)
    evaluation.write()
    run.seal.require_intact(run.fast_certificate)
    content = evaluation.content["fast_certificate"]
    assert content["samples"] == 17
    assert [entry["level"] for entry in content["mean"]] == [0.9]
    fast = surrogate.fast_certificate
    split = split_training(dataset.train, surrogate.description.run)
    largest = []
    for rows in (split.validation_rows, split.calibration_rows):
        samples = dataset.nodal_train(rows)
        predicted = surrogate.predict(samples.force)
        error, rest, softest = fast.estimate.with_stability(samples.force, predicted)
        true = np.abs(predicted - samples.displacement).mean(axis=(1, 2))
        estimated = np.abs(error).mean(axis=(1, 2)) + np.abs(rest).mean(axis=(1, 2)) / softest
        largest.append((true / estimated).max())
    assert fast.factor(0.9) == pytest.approx(max(largest), rel=1e-4)
    run.fast_certificate.write_bytes(serialised(load_tensors(run.fast_certificate)[0]))
    with pytest.raises(InputError, match="calibrated for the estimate of another version"):
        read_calibration(run.fast_certificate)


def test_early_stopping_has_seen_the_validation_samples(
    make_run: Callable[..., Path], data: Path
) -> None:
    folder = make_run(epochs=3, calibration_fraction=0.25, early_stopping={"patience": 2})
    content = evaluate(folder, data, certify=True).content
    assert content["fast_certificate"]["samples"] == 12


def test_without_held_out_samples(make_run: Callable[..., Path], data: Path) -> None:
    folder = make_run(epochs=1, validation_fraction=0.0)
    with pytest.raises(InputError, match="no held-out samples"):
        evaluate(folder, data, certify=True)


def test_size_of_what_the_estimate_leaves(estimate: FastEstimate) -> None:
    """Two steps leave s: with K(u)⁻¹ s, the error is that of Newton's step; P s / θ is as large."""
    body, equilibrium = box("quad"), Equilibrium(box("quad"), MATERIAL)
    force = end_load(body, 1.0, 1.0)
    predicted = correct(equilibrium, force, 0 * force).displacement
    predicted = predicted + 1e-4 * body.coordinates[:, :1] ** 2
    error, rest, softest = estimate.with_stability(force[None], predicted[None])
    response = equilibrium.response_at(predicted)
    assert response is not None
    newton = response(equilibrium.out_of_balance(predicted[None], force[None]))[0]
    missing = np.abs(newton - error[0]).mean()
    assert 0 < missing <= 1.2 * np.abs(rest[0]).mean() / softest[0]
    found = with_rest(error, rest, softest)["mean"][0]
    assert found == pytest.approx(np.abs(error).mean() + np.abs(rest).mean() / softest[0])
    assert with_rest(error, rest, np.zeros(1))["mean"][0] < np.inf
