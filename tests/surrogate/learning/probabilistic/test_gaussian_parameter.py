from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter, inverse_softplus

PRIOR_STD = 0.3


def spread(trainable_prior: bool = True) -> GaussianParameter:
    """A parameter of 60 weights in double precision, no two of them the same."""
    generator = torch.Generator().manual_seed(0)

    def normal() -> Tensor:
        return torch.randn(3, 4, 5, generator=generator, dtype=torch.float64)

    parameter = GaussianParameter(normal(), 0.1, PRIOR_STD, trainable_prior)
    with torch.no_grad():
        parameter.rho.add_(normal())
        if trainable_prior:
            parameter.prior_mean.add_(0.2 * normal())
    return parameter


def posterior(parameter: GaussianParameter) -> Any:
    return Normal(parameter.mean, parameter.std)


def prior(parameter: GaussianParameter) -> Any:
    return Normal(parameter.prior_mean, PRIOR_STD)


@pytest.mark.parametrize("std", [1e-6, 1e-4, 0.01, 0.1, math.log(2), 1.0, 10.0])
def test_inverse_softplus(std: float) -> None:
    """In double precision, and in the single precision of a weight: ρ = -13.8 for 1e-6."""
    rho = inverse_softplus(std)
    assert math.log1p(math.exp(rho)) == pytest.approx(std, rel=1e-9)
    single = GaussianParameter(torch.zeros(3), std, 1.0, True)
    assert single.rho.dtype == torch.float32
    assert single.std.tolist() == pytest.approx([std] * 3, rel=2e-6)


@pytest.mark.parametrize("trainable", [True, False])
def test_closed_divergence_against_torch(trainable: bool) -> None:
    parameter = spread(trainable)
    expected = kl_divergence(posterior(parameter), prior(parameter)).sum()
    torch.testing.assert_close(parameter.kl_divergence(), expected, rtol=1e-12, atol=0)


def test_divergence_by_hand() -> None:
    """σ = σ_p = 1/2 and means 1 apart: (1 / 0.5)² / 2 = 2 nats a weight; no distance, no nats."""
    parameter = GaussianParameter(torch.ones(3, dtype=torch.float64), 0.5, 0.5, False)
    assert parameter.kl_divergence().item() == pytest.approx(6.0, rel=1e-12)
    same = GaussianParameter(torch.ones(3, dtype=torch.float64), 0.5, 0.5, True)
    assert same.kl_divergence().item() == pytest.approx(0.0, abs=1e-12)


def test_sampled_divergence_is_the_closed_one_on_average() -> None:
    """Within four standard errors of a mean over 4000 noises."""
    parameter, generator = spread(), torch.Generator().manual_seed(1)
    noises = torch.randn(4000, *parameter.mean.shape, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        found = torch.stack([parameter.sampled_kl_divergence(noise) for noise in noises])
        standard_error = float(found.std()) / math.sqrt(len(found))
        assert abs(float(found.mean() - parameter.kl_divergence())) < 4 * standard_error
        assert standard_error < 0.01 * float(parameter.kl_divergence())


def test_gradients_by_hand() -> None:
    """(μ - μ_p) / σ_p², its negative, and (σ / σ_p² - 1 / σ) dσ/dρ with dσ/dρ = 1 / (1 + e^-ρ)."""
    parameter = spread()
    assert isinstance(parameter.prior_mean, torch.nn.Parameter)
    parameter.kl_divergence().backward()  # type: ignore[no-untyped-call]
    offset = (parameter.mean - parameter.prior_mean) / PRIOR_STD**2
    slope = (parameter.std / PRIOR_STD**2 - 1 / parameter.std) * torch.sigmoid(parameter.rho)
    torch.testing.assert_close(parameter.mean.grad, offset)
    torch.testing.assert_close(parameter.prior_mean.grad, -offset)
    torch.testing.assert_close(parameter.rho.grad, slope)


def test_prior_means() -> None:
    """Trainable ones start at the weights' means; those at zero are kept, but not trained."""
    mean = torch.tensor([1.0, -2.0])
    trainable = GaussianParameter(mean, 0.1, 0.3, trainable_prior=True)
    assert {name for name, _ in trainable.named_parameters()} == {"mean", "rho", "prior_mean"}
    assert torch.equal(trainable.prior_mean, mean)
    zero = GaussianParameter(mean, 0.1, 0.3, trainable_prior=False)
    assert {name for name, _ in zero.named_parameters()} == {"mean", "rho"}
    assert torch.equal(zero.prior_mean, torch.zeros(2))
    assert set(zero.state_dict()) == set(trainable.state_dict()) == {"mean", "rho", "prior_mean"}


def test_draws_have_the_posterior_of_every_weight() -> None:
    """Over 4000 draws, within five standard errors: σ / √T of a mean, σ / √(2T) of a deviation."""
    parameter, passes = spread(), 4000
    with torch.no_grad():
        draws = parameter.draw([torch.Generator().manual_seed(seed) for seed in range(passes)])
        assert draws.shape == (passes, 3, 4, 5)
        z = (draws - parameter.mean) / parameter.std
    assert z.mean(dim=0).abs().max() < 5 / math.sqrt(passes)
    assert (z.std(dim=0) - 1).abs().max() < 5 / math.sqrt(2 * passes)


def test_a_draw_depends_on_its_own_generator_only() -> None:
    parameter = spread()
    draws = parameter.draw([torch.Generator().manual_seed(seed) for seed in (7, 8, 9)])
    alone = parameter.draw([torch.Generator().manual_seed(8)])
    assert torch.equal(draws[1], alone[0])
    assert not torch.equal(draws[0], draws[1])
