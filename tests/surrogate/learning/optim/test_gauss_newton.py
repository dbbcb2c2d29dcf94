from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.optim.gauss_newton import GaussNewtonStd
from surrogate.learning.probabilistic.flipout import FlipoutConvolution, VariationalConfig
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.likelihoods import Errors
from tests.surrogate.resuming import assert_resumes

MakeConfig = Callable[..., UNetModel]
PRIOR = 0.3


class Linear(nn.Module):
    """A network whose means are linear in a probabilistic kernel, with a constant ρ from a bias.

    Its evidence lower bound is known in closed form.
    """

    def __init__(self, rho: float) -> None:
        super().__init__()
        convolution = nn.Conv2d(2, 4, 3, padding=1)
        nn.init.zeros_(convolution.weight[2:])
        assert convolution.bias is not None
        nn.init.constant_(convolution.bias, rho)
        config = VariationalConfig(prior_std=PRIOR, biases=False)
        self.layer = FlipoutConvolution(convolution, config)

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = self.layer(x)
        return y


def field_network(dataset: Dataset, rho: float) -> FieldNetwork:
    torch.manual_seed(0)
    return FieldNetwork(Linear(rho), dataset.geometry, dataset.info).eval()


def fisher_information(
    network: FieldNetwork, force: Tensor, factors: tuple[float, float] = (1.0, 2.0)
) -> Tensor:
    """Compute h with one gradient per datum of mean/σ and one of ln σ."""
    layer = network.network.layer
    assert isinstance(layer, FlipoutConvolution)
    prediction = network(force)
    assert prediction.std is not None
    total = torch.zeros_like(layer.kernel.mean)
    for field, factor in zip((prediction.mean, prediction.std), factors, strict=True):
        for value, std in zip(
            field.flatten(1)[:, network.free_components].flatten(),
            prediction.std.flatten(1)[:, network.free_components].flatten(),
            strict=True,
        ):
            (g,) = torch.autograd.grad(value / std.detach(), layer.kernel.mean, retain_graph=True)
            total += factor * g.square()
    return total.detach()


@pytest.mark.parametrize(("errors", "factors"), [("gaussian", (1.0, 2.0)), ("laplace", (2.0, 1.0))])
def test_fisher_information_against_one_gradient_a_datum(
    dataset: Dataset, errors: Errors, factors: tuple[float, float]
) -> None:
    """The mean of many estimates is h; each has a relative standard deviation below √2."""
    network = field_network(dataset, rho=-2.0)
    force = dataset.train.force[:3]
    spreads = GaussNewtonStd(network, samples=3, errors=errors)
    torch.manual_seed(1)
    count = 2000
    mean = sum(spreads._squared_gradients(force) for _ in range(count)) / count
    expected = fisher_information(network, force, factors).flatten()
    assert expected.max() > 10 * PRIOR**-2
    torch.testing.assert_close(mean, expected, rtol=6 * math.sqrt(2 / count), atol=0.0)


@pytest.mark.parametrize("factor", [1.0, 0.25])
def test_spread_maximises_the_bound_of_a_linear_network(dataset: Dataset, factor: float) -> None:
    r"""The derivative of E_q[NLL] + κ KL by σ is σ h − κ (1/σ − σ/σ_p²).

    It is zero at 1/σ² = 1/σ_p² + h/κ.
    """
    network = field_network(dataset, rho=-2.0)
    layer = network.network.layer
    assert isinstance(layer, FlipoutConvolution)
    force = dataset.train.force[:3]
    spreads = GaussNewtonStd(network, samples=3)
    torch.manual_seed(1)
    for _ in range(600):
        spreads.update(spreads.estimate(force, len(force)), factor)
    h = fisher_information(network, force)
    std = layer.kernel.std.detach()
    torch.testing.assert_close(
        std, (h / factor + PRIOR**-2).rsqrt(), rtol=0.25, atol=0.0
    )  # the average of 200 estimates has a relative standard deviation of 1/10 in h
    mean_slope = (std * h - factor * (1 / std - std / PRIOR**2))[:2].mean() / (std * h)[:2].mean()
    assert abs(mean_slope.item()) < 0.05


def test_weights_without_information_keep_the_prior(dataset: Dataset) -> None:
    network = field_network(dataset, rho=-2.0)
    layer = network.network.layer
    assert isinstance(layer, FlipoutConvolution)
    spreads = GaussNewtonStd(network, samples=3)
    spreads.update(spreads.estimate(torch.zeros_like(dataset.train.force[:3]), 3), 1.0)
    torch.testing.assert_close(layer.kernel.std, torch.full_like(layer.kernel.std, PRIOR))


def test_a_larger_dataset_narrows_the_posterior(dataset: Dataset) -> None:
    """1/σ² − 1/σ_p² is proportional to N."""
    found = []
    for samples in (3, 300):
        network = field_network(dataset, rho=-5.0)
        layer = network.network.layer
        assert isinstance(layer, FlipoutConvolution)
        spreads = GaussNewtonStd(network, samples)
        torch.manual_seed(1)
        spreads.update(spreads.estimate(dataset.train.force[:3], 3), 1.0)
        found.append(layer.kernel.std.detach()[:2] ** -2 - PRIOR**-2)
    assert (found[0] > PRIOR**-2).float().mean() > 0.5
    torch.testing.assert_close(found[1], 100 * found[0], rtol=1e-3, atol=1e-3)


def test_k_and_k_epochs_are_2k(tmp_path: Path, dataset: Dataset, make_config: MakeConfig) -> None:
    config = make_config(
        likelihood="variational_bayes",
        variational={"posterior_std": "gauss_newton", "biases": True},
        epochs=4,
    )
    assert_resumes(config, dataset, tmp_path, stop_after=2)


def test_rho_gets_no_gradient_step(dataset: Dataset) -> None:
    network = field_network(dataset, rho=-2.0)
    GaussNewtonStd(network, samples=3)
    parameters = [m for m in network.modules() if isinstance(m, GaussianParameter)]
    assert [p.rho.requires_grad for p in parameters] == [False]
    assert all(p.mean.requires_grad for p in parameters)
