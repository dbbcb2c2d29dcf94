from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Laplace, Normal

from surrogate.learning.probabilistic.likelihoods import (
    Errors,
    Loss,
    Prediction,
    deterministic_loss,
    negative_log_likelihood,
    output_channels,
)


@pytest.mark.parametrize("dimension", [2, 3])
def test_one_channel_a_component_and_one_more_for_its_spread(dimension: int) -> None:
    assert output_channels("deterministic", dimension) == dimension
    assert output_channels("maximum_likelihood", dimension) == 2 * dimension
    assert output_channels("variational_bayes", dimension) == 2 * dimension


@pytest.mark.parametrize(("loss", "power"), [("mse", 2), ("mae", 1)])
def test_against_numpy(loss: Loss, power: int) -> None:
    predicted, reference = np.random.default_rng(0).normal(size=(2, 5, 2, 8, 4))
    expected = np.mean((np.abs(predicted - reference) / 0.25) ** power)
    found = deterministic_loss(
        loss, torch.from_numpy(predicted), torch.from_numpy(reference), torch.tensor(0.25)
    )
    assert found.item() == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("loss", "expected"),
    [
        ("mse", 3.125),  # errors of 3 and -4 over a unit of 2: (1.5² + 2²) / 2
        ("mae", 1.75),  # (1.5 + 2) / 2
    ],
)
def test_by_hand(loss: Loss, expected: float) -> None:
    predicted = torch.tensor([[3.0, -4.0]])
    found = deterministic_loss(loss, predicted, torch.zeros(1, 2), torch.tensor(2.0))
    assert found.item() == expected


GRIDS: dict[int, tuple[int, ...]] = {2: (4, 3), 3: (3, 2, 2)}
POINTS = torch.tensor([1, 4, 5, 10])  # of 12 grid points


def fields(dimension: int) -> tuple[Prediction, Tensor]:
    """Predictions and references of 5 samples; where nothing is free, what has no likelihood."""
    generator = torch.Generator().manual_seed(0)
    shape = (5, dimension, *GRIDS[dimension])
    mean, reference, spread = (
        torch.randn(shape, generator=generator, dtype=torch.float64) for _ in range(3)
    )
    std = torch.zeros_like(mean)
    free = free_components(dimension)
    std.flatten(1)[:, free] = (0.5 * spread).exp().flatten(1)[:, free]
    mean.flatten(2)[..., 0] = torch.nan
    return Prediction(mean, std), reference


def free_components(dimension: int) -> Tensor:
    """Those of the points, but for the last component of the last one."""
    return torch.cat([POINTS + 12 * component for component in range(dimension)])[:-1]


def at_free(field: Tensor) -> Tensor:
    return field.flatten(1)[:, free_components(field.shape[1])]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("unit", [1.0, 0.25])
@pytest.mark.parametrize("errors", ["gaussian", "laplace"])
def test_likelihood_against_torch(dimension: int, unit: float, errors: Errors) -> None:
    """Free components only. A density in 1/m is one over the unit times that in units."""
    prediction, reference = fields(dimension)
    assert prediction.std is not None
    mean, std = at_free(prediction.mean), at_free(prediction.std)
    free = free_components(dimension)
    of_errors: Any = Normal(mean, std) if errors == "gaussian" else Laplace(mean, std / 2**0.5)
    expected = -of_errors.log_prob(at_free(reference)).mean() - math.log(unit)
    scale = torch.tensor(unit, dtype=torch.float64)
    found = negative_log_likelihood(prediction, reference, free, scale, errors=errors)
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=0)
    unweighted = negative_log_likelihood(prediction, reference, free, scale, 0.0, errors)
    assert torch.equal(unweighted, found)


def two_points() -> tuple[Prediction, Tensor, Tensor]:
    """Errors 1 and 3, deviations 1 and 2; a third point is not free."""
    mean = torch.tensor([[[[1.0, 0.0, 7.0]]]], requires_grad=True)
    std = torch.tensor([[[[1.0, 2.0, 0.0]]]], requires_grad=True)
    return Prediction(mean, std), torch.tensor([[[[0.0, 3.0, 0.0]]]]), torch.tensor([0, 1])


@pytest.mark.parametrize(
    ("beta", "weights"),
    [
        (0.0, (1.0, 1.0)),
        (0.5, (2 / 3, 4 / 3)),  # 1 and 2 over their mean 3/2
        (1.0, (2 / 5, 8 / 5)),  # 1 and 4 over their mean 5/2
    ],
)
def test_weighted_likelihood_by_hand(beta: float, weights: tuple[float, float]) -> None:
    """ln σ + (e / σ)² / 2 + ln(2π) / 2: 1/2 and ln 2 + 9/8 nats, and the last term in both."""
    prediction, reference, free = two_points()
    terms = (0.5, math.log(2) + 9 / 8)
    constant = 0.5 * math.log(2 * math.pi)
    expected = sum(w * (t + constant) for w, t in zip(weights, terms, strict=True)) / 2
    found = negative_log_likelihood(prediction, reference, free, torch.tensor(1.0), beta)
    assert found.item() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0])
def test_weighted_gradients_by_hand(beta: float) -> None:
    """Weights are constants: e / σ² and 1 / σ - e² / σ³ by weight, over two components.

    At β = 1 the gradient of a mean is its error but for one factor, as with least squares. No
    gradient comes from the point that is not free, though its deviation is zero.
    """
    prediction, reference, free = two_points()
    assert prediction.std is not None
    found = negative_log_likelihood(prediction, reference, free, torch.tensor(1.0), beta)
    found.backward()  # type: ignore[no-untyped-call]
    error, std = torch.tensor([1.0, -3.0]), torch.tensor([1.0, 2.0])
    weight = std ** (2 * beta) / (std ** (2 * beta)).mean() / 2
    for field, slope in (
        (prediction.mean, error / std**2),
        (prediction.std, 1 / std - error**2 / std**3),
    ):
        assert field.grad is not None
        torch.testing.assert_close(field.grad.flatten()[:2], weight * slope)
        assert field.grad.flatten()[2] == 0
    if beta == 1.0:
        assert prediction.mean.grad is not None
        torch.testing.assert_close(prediction.mean.grad.flatten()[:2], error / 5)


def test_likelihood_is_best_at_the_spread_of_the_errors() -> None:
    """Errors of ±0.3 m are most likely at σ = 0.3 m: ln 0.3 + 1/2 + ln(2π) / 2 nats."""
    reference = torch.tensor([0.3, -0.3]).reshape(1, 1, 2, 1)

    def loss(std: float) -> float:
        prediction = Prediction(torch.zeros_like(reference), torch.full_like(reference, std))
        free, unit = torch.tensor([0, 1]), torch.tensor(1.0)
        return negative_log_likelihood(prediction, reference, free, unit).item()

    assert loss(0.3) == pytest.approx(math.log(0.3) + 0.5 + 0.5 * math.log(2 * math.pi))
    assert loss(0.3) < min(loss(0.29), loss(0.31))
