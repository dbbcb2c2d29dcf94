"""Statistics are over many passes of fixed seeds, with bounds in standard errors of their own.

For a fixed input x the output of a convolution is linear in its kernel, y = J w + b, so that its
distribution is known: mean J μ + b and covariance J diag(σ²) Jᵀ. Flipping signs leaves a Gaussian
kernel as it is distributed, so every sample's output is exactly a Gaussian of these moments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.distributions import Normal, kl_divergence

from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.flipout import (
    CONVOLVE,
    FlipoutConvolution,
    VariationalConfig,
    VariationalConvolutions,
    convolved_by_products,
    flipouts,
    random_signs,
)
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.stochastic_passes import using
from surrogate.runtime.device import convolutions

PASSES = 1000
GRIDS: dict[int, tuple[int, ...]] = {2: (4, 3), 3: (3, 2, 2)}
INPUTS, OUTPUTS = 3, 2


def layer_of(dimension: int, **config: Any) -> FlipoutConvolution:
    """A layer in training, with standard deviations from 0.1 to 2."""
    torch.manual_seed(0)
    kinds: dict[int, type[nn.Conv2d | nn.Conv3d]] = {2: nn.Conv2d, 3: nn.Conv3d}
    convolution = kinds[dimension](INPUTS, OUTPUTS, 3, padding=1)
    layer = FlipoutConvolution(convolution, VariationalConfig(initial_std=0.5, **config))
    with torch.no_grad():
        layer.kernel.rho.add_(0.5 * torch.randn_like(layer.kernel.rho))
    return layer


def input_of(dimension: int, samples: int) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.randn(samples, INPUTS, *GRIDS[dimension], generator=generator)


def bias_of(layer: FlipoutConvolution) -> GaussianParameter:
    assert isinstance(layer.bias, GaussianParameter)
    return layer.bias


@torch.no_grad()
def outputs(layer: Callable[[Tensor], Tensor], x: Tensor) -> Tensor:
    """Outputs of many forward passes, (passes, N, outputs · points)."""
    return torch.stack([layer(x).flatten(1) for _ in range(PASSES)])


@dataclass(frozen=True)
class Passes:
    """Passes of a layer on a batch of three samples, of which the first two are equal."""

    layer: FlipoutConvolution
    dimension: int
    x: Tensor
    outputs: Tensor


@pytest.fixture(scope="module", params=[(2, False), (2, True), (3, True)], ids=str)
def passes(request: pytest.FixtureRequest) -> Passes:
    dimension, biases = request.param
    layer = layer_of(dimension, biases=biases, prior_mean="zero", prior_std=0.3)
    x = input_of(dimension, 2)[[0, 0, 1]]
    return Passes(layer, dimension, x, outputs(layer, x))


@torch.no_grad()
def exact(layer: FlipoutConvolution, x: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and covariance of the flattened output of one sample (1, inputs, …); see the top."""
    bias = layer.bias.mean if isinstance(layer.bias, GaussianParameter) else layer.bias
    convolve = layer.convolve
    mean = convolve(x, layer.kernel.mean, bias, padding=1).flatten()
    unit = torch.eye(layer.kernel.mean.numel()).reshape(-1, *layer.kernel.mean.shape)
    jacobian = torch.stack([convolve(x, w, padding=1).flatten() for w in unit], dim=1)
    covariance = (jacobian * layer.kernel.std.flatten().square()) @ jacobian.T
    if isinstance(layer.bias, GaussianParameter):
        channel = torch.arange(len(mean)) // math.prod(x.shape[2:])
        same = channel[:, None] == channel
        covariance += same * layer.bias.std[channel].square()
    return mean, covariance


def assert_moments(found: Tensor, mean: Tensor, covariance: Tensor) -> None:
    """Mean and covariance of (passes, values) within five standard errors of those expected.

    The standard error of a covariance of Gaussians is √((C_ii C_jj + C_ij²) / T).
    """
    variance = covariance.diagonal()
    assert bool(((found.mean(0) - mean).abs() < 5 * (variance / len(found)).sqrt()).all())
    error = ((torch.outer(variance, variance) + covariance.square()) / len(found)).sqrt()
    assert bool(((found.T.cov() - covariance).abs() < 5 * error).all())


def assert_same_mean_and_variance(found: Tensor, other: Tensor) -> None:
    """At every point; two means differ by √(2 / T) deviations, two variances by √(4 / T)."""
    difference = (found.mean(0) - other.mean(0)) / other.std(0)
    assert difference.abs().max() < 5 * math.sqrt(2 / len(found))
    assert (found.var(0) / other.var(0) - 1).abs().max() < 5 * math.sqrt(4 / len(found))


def test_moments_of_every_sample(passes: Passes) -> None:
    """Compared with the closed form over all channels and points."""
    for sample in range(3):
        expected = exact(passes.layer, passes.x[sample : sample + 1])
        assert_moments(passes.outputs[:, sample], *expected)


def test_bounds_on_moments_are_sharp_enough(passes: Passes) -> None:
    """A quarter more of variance would be found, and a mean off by a fifth of a deviation."""
    mean, covariance = exact(passes.layer, passes.x[:1])
    for wrong in (
        (mean, 1.25 * covariance),
        (mean + 0.2 * covariance.diagonal().sqrt(), covariance),
    ):
        with pytest.raises(AssertionError):
            assert_moments(passes.outputs[:, 0], *wrong)


def test_moments_are_those_of_kernels_sampled_one_by_one(passes: Passes) -> None:
    layer, x = passes.layer, passes.x[:1]
    torch.manual_seed(2)

    def convolved() -> Tensor:
        kernel = torch.normal(layer.kernel.mean, layer.kernel.std)
        if isinstance(layer.bias, GaussianParameter):
            bias = torch.normal(layer.bias.mean, layer.bias.std)
        else:
            bias = layer.bias
        return CONVOLVE[passes.dimension](x, kernel, bias, padding=1).flatten()

    with torch.no_grad():
        sampled = torch.stack([convolved() for _ in range(PASSES)])
        assert_moments(sampled, *exact(layer, x))
    assert_same_mean_and_variance(passes.outputs[:, 0], sampled)


def test_perturbations_of_different_samples_are_uncorrelated(passes: Passes) -> None:
    """This holds for the two equal samples, too, which one shared kernel would perturb equally.

    The standard error is √(3 / T) at most, as for products of a Gaussian with itself, which have
    wide tails: hence seven.
    """
    correlation = passes.outputs.flatten(1).T.corrcoef()
    sample = torch.arange(len(correlation)) // passes.outputs.shape[2]
    across = correlation[sample[:, None] != sample]
    assert across.abs().max() < 7 * math.sqrt(3 / PASSES)
    within = (
        correlation[sample[:, None] == sample]
        - torch.eye(passes.outputs.shape[2]).repeat(3, 1).flatten()
    )
    assert within.abs().max() > 0.5


def test_every_output_channel_has_a_sign_of_its_own() -> None:
    """The outputs of two equal samples with one input channel differ by signs only.

    Equal signs have probability one half in each of two channels, and are independent in each
    of the other: over T passes within five standard errors 1 / (2√T).
    """
    torch.manual_seed(0)
    layer = FlipoutConvolution(nn.Conv2d(1, 2, 3, padding=1), VariationalConfig(initial_std=0.5))
    x = torch.randn(1, 1, *GRIDS[2])
    perturbation = outputs(layer, x.expand(2, -1, -1, -1)) - exact(layer, x)[0]
    one, other = perturbation.reshape(PASSES, 2, 2, -1).unbind(1)
    torch.testing.assert_close(one.abs(), other.abs())
    same = (one * other).sum(2) > 0
    bound = 5 / (2 * math.sqrt(PASSES))
    assert (same.float().mean(0) - 0.5).abs().max() < bound
    assert abs((same[:, 0] == same[:, 1]).float().mean() - 0.5) < bound


def test_probabilistic_biases_move_a_channel_as_a_whole() -> None:
    """With a zero input only the bias is left: the same at all points, other in every sample."""
    layer = layer_of(2, biases=True)
    found = outputs(layer, torch.zeros(2, INPUTS, *GRIDS[2])).reshape(PASSES, 2, OUTPUTS, -1)
    assert torch.equal(found, found[..., :1].expand_as(found))
    bias = bias_of(layer)
    z = (found[..., 0] - bias.mean) / bias.std
    assert z.mean(0).abs().max() < 5 / math.sqrt(PASSES)
    assert (z.std(0) - 1).abs().max() < 5 / math.sqrt(2 * PASSES)
    assert z.flatten(1).T.corrcoef().fill_diagonal_(0).abs().max() < 5 / math.sqrt(PASSES)


def test_against_bayesian_torch(passes: Passes) -> None:
    """Its divergence is a mean over the weights; mean and variance at every point are the same.

    Correlations between points are not: it draws a sign for every point of the grid, so that no
    two points see the same kernel. What it calls the variance of the prior is σ_p.
    """
    layers = pytest.importorskip("bayesian_torch.layers")
    kind = {2: layers.Conv2dFlipout, 3: layers.Conv3dFlipout}[passes.dimension]
    layer, x = passes.layer, passes.x[:1]
    other = kind(INPUTS, OUTPUTS, 3, padding=1, prior_mean=0, prior_variance=0.3)
    divergence = layer.kernel.kl_divergence() / layer.kernel.mean.numel()
    with torch.no_grad():
        other.mu_kernel.copy_(layer.kernel.mean)
        other.rho_kernel.copy_(layer.kernel.rho)
        if isinstance(layer.bias, GaussianParameter):
            other.mu_bias.copy_(layer.bias.mean)
            other.rho_bias.copy_(layer.bias.rho)
            divergence = divergence + layer.bias.kl_divergence() / layer.bias.mean.numel()
        else:
            other.bias = False
            other.mu_bias.copy_(layer.bias)
    torch.testing.assert_close(other.kl_loss(), divergence)
    theirs = outputs(lambda x: other(x, return_kl=False), x)[:, 0]
    ours = passes.outputs[:, 0]
    assert_same_mean_and_variance(ours, theirs)
    one = torch.eye(ours.shape[1])
    assert (theirs.T.corrcoef() - one).abs().max() < 5 * math.sqrt(3 / PASSES)
    assert (ours.T.corrcoef() - one).abs().max() > 0.4


@pytest.mark.parametrize("biases", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_evaluation_uses_the_means(dimension: int, biases: bool) -> None:
    layer, x = layer_of(dimension, biases=biases).eval(), input_of(dimension, 2)
    bias = layer.bias.mean if isinstance(layer.bias, GaussianParameter) else layer.bias
    expected = CONVOLVE[dimension](x, layer.kernel.mean, bias, padding=1)
    assert torch.equal(layer(x), expected)
    assert not torch.equal(layer.train()(x), expected)


@pytest.mark.parametrize("biases", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_drawn_kernels_are_used_part_by_part(dimension: int, biases: bool) -> None:
    """3 draws on a batch of 3 · 2 samples, in training as in evaluation; then the means again."""
    layer, x = layer_of(dimension, biases=biases).eval(), input_of(dimension, 6)
    means = layer(x)

    def generators() -> list[torch.Generator]:
        return [torch.Generator().manual_seed(seed) for seed in (3, 4, 5)]

    for training in (False, True):
        drawn = layer.train(training).draw(generators())
        with using({layer: drawn}):
            found = layer(x)
        again = generators()
        drawn_bias = bias_of(layer).draw(again) if biases else [layer.bias] * 3
        kernels = layer.kernel.draw(again)
        expected = [
            CONVOLVE[dimension](x[2 * t : 2 * t + 2], kernels[t], drawn_bias[t], padding=1)
            for t in range(3)
        ]
        torch.testing.assert_close(found, torch.cat(expected), rtol=1e-5, atol=1e-5)
        found = convolved_by_products(x, *drawn)
        torch.testing.assert_close(found, torch.cat(expected), rtol=1e-5, atol=1e-5)
    assert torch.equal(layer.eval()(x), means)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("dimension", [2, 3])
def test_drawn_kernels_on_a_gpu(dimension: int) -> None:
    """The same as on a CPU; nearly so with rounded factors."""
    layer, x = layer_of(dimension).eval(), input_of(dimension, 6)
    found = []
    for device in ("cpu", "cuda"):
        drawn = layer.to(device).draw([torch.Generator().manual_seed(seed) for seed in (3, 4, 5)])
        for precision in ("float32", "tensorfloat32"):
            with torch.no_grad(), using({layer: drawn}), convolutions(precision):
                found.append(layer(x.to(device)).cpu())
    torch.testing.assert_close(found[2], found[0], rtol=1e-5, atol=1e-5)
    size = found[0].abs().max()
    assert (found[3] - found[0]).abs().max() < 1e-2 * size


@pytest.mark.parametrize("biases", [False, True])
def test_closed_divergence_is_of_kernel_and_biases(biases: bool) -> None:
    layer = layer_of(2, biases=biases, prior_mean="zero", prior_std=0.3)
    parameters = [layer.kernel, *([bias_of(layer)] if biases else [])]
    expected = sum(kl_divergence(Normal(p.mean, p.std), Normal(0, 0.3)).sum() for p in parameters)
    torch.testing.assert_close(layer.kl_divergence(), expected)


@pytest.mark.parametrize("biases", [False, True])
def test_sampled_divergence_is_that_of_the_perturbation_just_used(biases: bool) -> None:
    """ln q - ln p at μ + σε, where the kernel's ε is the first draw of a pass.

    With one sample, one input and one output channel the signs change no more than the sign of ε,
    so that the output gives |ε|.
    """
    torch.manual_seed(0)
    config = VariationalConfig(
        kl_divergence="sampled", prior_mean="zero", prior_std=0.3, initial_std=0.5, biases=biases
    )
    layer = FlipoutConvolution(nn.Conv2d(1, 1, 3, padding=1), config)
    torch.manual_seed(5)
    y = layer(torch.ones(1, 1, 1, 1))
    torch.manual_seed(5)
    noise = torch.randn_like(layer.kernel.mean)
    weights = [(layer.kernel, layer.kernel.mean + layer.kernel.std * noise)]
    perturbation = y - layer.eval()(torch.ones(1, 1, 1, 1))
    if biases:
        for _ in range(2):  # the signs of input and output
            random_signs(noise, (1, 1, 1, 1))
        bias = bias_of(layer)
        offset = bias.std * torch.randn(1, 1)[0]
        weights.append((bias, bias.mean + offset))
        perturbation = perturbation - offset
    centre = (layer.kernel.std * noise)[0, 0, 1, 1]
    assert abs(perturbation.item()) == pytest.approx(abs(centre.item()), rel=1e-4)
    expected = torch.zeros(())
    for parameter, value in weights:
        posterior: Any = Normal(parameter.mean, parameter.std)
        prior: Any = Normal(0.0, 0.3)
        expected = expected + (posterior.log_prob(value) - prior.log_prob(value)).sum()
    torch.testing.assert_close(layer.kl_divergence(), expected)


def test_gradient_of_the_spread() -> None:
    """dy/dσ of one weight is ε times its input: its mean square over passes is that of x."""
    layer, x = layer_of(2), torch.zeros(1, INPUTS, *GRIDS[2])
    x[0, 1, 2, 1] = 3.0
    squares = torch.zeros_like(layer.kernel.rho)
    for _ in range(PASSES):
        (slope,) = torch.autograd.grad(layer(x)[0, 0, 2, 1], layer.kernel.rho)
        squares += slope.square() / PASSES
    found = squares / torch.sigmoid(layer.kernel.rho).square()
    expected = torch.zeros_like(found)
    expected[0, 1, 1, 1] = 9.0
    torch.testing.assert_close(found, expected, rtol=5 * math.sqrt(2 / PASSES), atol=0)


@pytest.mark.slow
def test_compiled_passes_differ_and_have_the_same_moments() -> None:
    layer, x = layer_of(2, biases=True, kl_divergence="sampled"), input_of(2, 2)
    compiled = torch.compile(layer)
    found = outputs(compiled, x)
    assert len(set(found[:, 0, 0].tolist())) == PASSES
    for sample in range(2):
        assert_moments(found[:, sample], *exact(layer, x[sample : sample + 1]))
    torch.manual_seed(1)
    first = compiled(x), layer.kl_divergence()
    torch.manual_seed(1)
    again = compiled(x), layer.kl_divergence()
    other = compiled(x), layer.kl_divergence()
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[1], again[1])
    assert not torch.equal(first[0], other[0])
    assert not torch.equal(first[1], other[1])


def test_random_signs() -> None:
    torch.manual_seed(0)
    signs = random_signs(torch.zeros(1, dtype=torch.float64), (10_000,))
    assert signs.dtype == torch.float64
    assert torch.equal(signs.abs(), torch.ones_like(signs))
    assert abs(signs.mean().item()) < 4 / 100


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        ({}, {"encoder.0.2", "encoder.1.2", "decoder.0.2"}),
        ({"convolutions": (1,), "levels": (1,)}, {"encoder.1.0"}),
        (
            {"convolutions": (1, 2), "levels": (0,)},
            {"encoder.0.0", "encoder.0.2", "decoder.0.0", "decoder.0.2"},
        ),
    ],
)
def test_chosen_convolutions_are_probabilistic(config: dict[str, Any], expected: set[str]) -> None:
    """Without batch norm the convolutions of a level are its layers 0 and 2."""
    shape = UNetConfig(levels=2, channels=4, batch_norm=False)
    network = UNet(2, 4, shape, VariationalConvolutions(**config))
    names = {module: name for name, module in network.named_modules()}
    assert {names[layer] for layer in flipouts(network)} == expected


def test_factor_by_hand() -> None:
    """100 steps, a warm-up over the first 20: (step + 1) / 20 of the weight, then all of it."""
    config = VariationalConfig(weight=0.5, warmup=0.2)
    found = [config.factor(step, 100) for step in (0, 9, 18, 19, 20, 99)]
    assert found == pytest.approx([0.025, 0.25, 0.475, 0.5, 0.5, 0.5])
    assert VariationalConfig().factor(0, 100) == 1.0
    assert VariationalConfig(warmup=1.0).factor(49, 100) == 0.5
    assert VariationalConfig(warmup=1e-3).factor(0, 100) == 1.0
