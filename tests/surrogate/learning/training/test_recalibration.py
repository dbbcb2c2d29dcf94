from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.samples import NodalSamples
from surrogate.learning.inference.loading import load
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.load_count_factor import LoadCountFactor
from surrogate.learning.probabilistic.calibration import half_width, measure_calibration
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.runs.split import split_training
from surrogate.learning.training.loop import train
from surrogate.learning.training.recalibration import (
    LEAST,
    fit_count_factors,
    fit_factors,
    groups_by_count,
    recalibrate,
)

FREE = np.array([False, True, True])


def standard_deviations(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two standard deviations that differ over 4000 samples, independently of each other."""
    aleatoric, epistemic = np.exp(rng.normal(size=(2, 4000, 3, 2)))
    return aleatoric, epistemic


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.5, 2.0), (3.0, 0.25)])
def test_factors_are_found(a: float, b: float) -> None:
    """Errors drawn with the variance a² σ_al² + b² σ_ep²; clamped nodes must not count."""
    rng = np.random.default_rng(0)
    aleatoric, epistemic = standard_deviations(rng)
    error = rng.normal(size=aleatoric.shape) * np.hypot(a * aleatoric, b * epistemic)
    error[:, 0] = 1e6
    predicted = Distribution(np.zeros_like(error), epistemic, aleatoric)
    assert fit_factors(predicted, error, FREE) == pytest.approx((a, b), rel=0.05)


def test_weight_uncertainty_counted_twice() -> None:
    """σ_al² = e² + σ_ep², as a head that is trained on draws finds it: e² = σ_al² − σ_ep²."""
    rng = np.random.default_rng(1)
    scale = np.exp(rng.normal(size=(4000, 3, 2)))
    aleatoric, epistemic = scale, 0.5 * scale
    error = rng.normal(size=scale.shape) * np.sqrt(1 - 0.25) * scale
    a, b = fit_factors(Distribution(np.zeros_like(error), epistemic, aleatoric), error, FREE)
    assert a**2 + 0.25 * b**2 == pytest.approx(0.75, rel=0.03)


def test_without_epistemic_uncertainty() -> None:
    """One factor, √(mean z²) in closed form."""
    rng = np.random.default_rng(2)
    aleatoric, _ = standard_deviations(rng)
    error = 0.3 * rng.normal(size=aleatoric.shape) * aleatoric
    predicted = Distribution(np.zeros_like(error), np.zeros_like(error), aleatoric)
    a, b = fit_factors(predicted, error, FREE)
    expected = np.sqrt(((error / aleatoric)[:, FREE] ** 2).mean())
    assert a == pytest.approx(expected, rel=1e-4)
    assert b == 1.0


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_intervals_of_the_level_hold_its_share(level: float) -> None:
    """Errors with the tails of Student's t of 3 degrees of freedom; a : b stays the likeliest."""
    rng = np.random.default_rng(3)
    aleatoric, epistemic = standard_deviations(rng)
    error = rng.standard_t(3, size=aleatoric.shape) * np.hypot(aleatoric, 2 * epistemic)
    predicted = Distribution(np.zeros_like(error), epistemic, aleatoric)
    likeliest = fit_factors(predicted, error, FREE)
    a, b = fit_factors(predicted, error, FREE, level)
    assert b / a == pytest.approx(likeliest[1] / likeliest[0])
    ratio = (np.abs(error) / np.hypot(a * aleatoric, b * epistemic))[:, FREE]
    assert (ratio <= half_width(level)).mean() == pytest.approx(level, abs=1e-4)


@pytest.mark.parametrize("likelihood", ["maximum_likelihood", "variational_bayes"])
def test_recalibration_of_a_run(
    tmp_path: Path, dataset: Dataset, make_config: Callable[..., UNetModel], likelihood: str
) -> None:
    """The same weights; the held-out samples become likelier, by the factors of `fit_factors`."""
    surrogates = {}
    for key in (False, True):
        config = make_config(
            likelihood=likelihood, epochs=10, validation_fraction=0.3, recalibrate=key
        )
        folder = tmp_path / str(key)
        train(config, dataset, folder, device="cpu")
        surrogates[key] = load(folder)
    held_out = split_training(dataset.train, config).validation
    grid = dataset.geometry.grid
    force, reference = (
        grid.to_nodes(field.double().numpy()) for field in (held_out.force, held_out.displacement)
    )
    free = ~dataset.geometry.clamped
    raw, scaled = (surrogates[key].predict_distribution(force, 100) for key in (False, True))
    a, b = fit_factors(raw, reference, free)
    assert abs(a - 1) > 0.01
    np.testing.assert_array_equal(scaled.mean, raw.mean)
    np.testing.assert_allclose(scaled.std_aleatoric, a * raw.std_aleatoric, rtol=1e-5)
    np.testing.assert_allclose(scaled.std_epistemic, b * raw.std_epistemic, rtol=1e-5)
    before, after = (measure_calibration(p.mean, p.std, reference, free) for p in (raw, scaled))
    assert after.negative_log_likelihood < before.negative_log_likelihood


def test_it_needs_held_out_samples(make_config: Callable[..., UNetModel]) -> None:
    with pytest.raises(InputError, match="recalibrate expects validation_fraction > 0, found 0"):
        make_config(likelihood="maximum_likelihood", validation_fraction=0.0, recalibrate=True)


def test_factors_fade_beyond_the_training_range(evaluated: Path) -> None:
    """a^w with w = r⁻⁴: at 0.5, 1 and 2 times the largest force a, a and a^(1/16)."""
    model = load(evaluated)
    model.network.aleatoric_factor.fill_(0.4)
    model.network.epistemic_factor.fill_(0.9)
    force = torch.zeros(3, *model.geometry.coordinates.shape)
    limit = max(model.description.data.info.force.max_abs)
    force[:, 31, 1] = torch.tensor([0.5, -1.0, 2.0]) * limit
    aleatoric, epistemic = model.predictor.network.factors(force)
    assert aleatoric.shape == (3, 1, 1)
    torch.testing.assert_close(aleatoric.flatten(), torch.tensor([0.4, 0.4, 0.4 ** (1 / 16)]))
    torch.testing.assert_close(epistemic.flatten(), torch.tensor([0.9, 0.9, 0.9 ** (1 / 16)]))


def force_on(nodes: int) -> np.ndarray:
    """Forces of 1 N on the first of 20 nodes."""
    force = np.zeros((20, 2))
    force[:nodes, 1] = 1.0
    return force


def test_factors_by_the_number_of_loads_are_found() -> None:
    """Errors of three times the predicted size under one load, of half of it under four."""
    rng = np.random.default_rng(4)
    counts = np.repeat([1, 4], 400)
    truth = np.where(counts == 1, 3.0, 0.5)
    ratios = np.abs(rng.normal(size=(800, 10))) * truth[:, None]
    for level in (None, 0.9):
        numbers, factors = fit_count_factors(ratios, counts, level)
        assert numbers == [1, 4]
        assert factors == pytest.approx([3, 0.5], rel=0.05)


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        (np.repeat([1, 2, 3, 4], 30), [30, 30, 30, 30]),
        (np.repeat([0, 1, 2, 3, 4], [9, 29, 40, 31, 31]), [69, 31, 31]),
        (np.repeat([1, 2], [100, 29]), [129]),
        (np.repeat([5], 100), [100]),
        (np.repeat(np.arange(1, 13), 20), [60, 60, 60, 60]),
    ],
)
def test_groups_of_enough_samples(counts: np.ndarray, expected: list[int]) -> None:
    groups = groups_by_count(counts)
    assert [int(group.sum()) for group in groups] == expected
    assert not np.any(sum(group.astype(int) for group in groups) > 1)
    if len(groups) == 1:
        assert fit_count_factors(np.full((len(counts), 3), 7.0), counts) == ([1.0], [1.0])


def test_factor_is_linear_between_the_knots() -> None:
    factor = LoadCountFactor()
    force = torch.from_numpy(np.stack([force_on(n) for n in (0, 1, 2, 3, 4, 9)])).float()
    torch.testing.assert_close(factor(force), torch.ones(6))
    factor.set([1.0, 3.0, 4.0], [2.0, 1.0, 5.0])
    torch.testing.assert_close(factor(force), torch.tensor([2.0, 2.0, 1.5, 1.0, 5.0, 5.0]))


@pytest.mark.parametrize("likelihood", ["maximum_likelihood", "variational_bayes"])
def test_every_number_of_loads_has_its_share(
    tmp_path: Path,
    dataset: Dataset,
    make_config: Callable[..., UNetModel],
    likelihood: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Errors of other sizes under one load and under four."""
    config = make_config(likelihood=likelihood, epochs=2, validation_fraction=0.3)
    train(config, dataset, tmp_path / "run", device="cpu")
    model = load(tmp_path / "run")
    rng = np.random.default_rng(5)
    free = np.flatnonzero(~dataset.geometry.clamped)
    force = np.zeros((2 * LEAST, *dataset.geometry.coordinates.shape))
    for number, of_sample in enumerate(force):
        nodes = rng.choice(free, 1 + 3 * (number % 2), replace=False)
        of_sample[nodes] = rng.uniform(-1, 1, (len(nodes), force.shape[2]))
    predicted = model.predict_distribution(force, 10)
    sizes = np.where(np.arange(len(force)) % 2, 4.0, 0.5)[:, None, None]
    error = sizes * predicted.std * rng.normal(size=force.shape)
    held_out = NodalSamples(force, predicted.mean + error)
    monkeypatch.setattr("surrogate.learning.training.recalibration.PASSES", 10)
    recalibrate(model, held_out, 0.9)
    after = model.predict_distribution(force, 10)
    inside = np.abs(error[:, free]) <= half_width(0.9) * after.std[:, free]
    assert inside[0::2].mean() == pytest.approx(0.9, abs=0.01)
    assert inside[1::2].mean() == pytest.approx(0.9, abs=0.01)
