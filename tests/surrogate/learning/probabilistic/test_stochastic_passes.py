"""Networks here are untrained, with a spread of the weights as large as the weights.

Statistics are over many passes of fixed seeds, with bounds in standard errors of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models import batched_prediction
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.flipout import (
    FlipoutConvolution,
    VariationalConvolutions,
    flipouts,
)
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import (
    Drawable,
    Passes,
    drawables,
    most_weights,
)
from surrogate.learning.runs.description import describe
from tests.surrogate.unet_configs import unet_config

Array = NDArray[np.float64]
DRAWS = 1000


def untrained(dataset: Dataset, levels: int = 2) -> Surrogate:
    """A small surrogate; every convolution is probabilistic, and every weight has a σ of its own.

    Batch norm keeps its first averages, 0 and 1.
    """
    config = unet_config(
        name="wild",
        case=dataset.manifest.name,
        likelihood="variational_bayes",
        network={"levels": levels, "channels": 2, "padding": 1},
        variational={"convolutions": [1, 2], "biases": True, "initial_std": 0.2},
    )
    description = describe(config, dataset)
    network = description.run.build(dataset.geometry, dataset.info)
    for layer in flipouts(network):
        nn.init.normal_(layer.kernel.rho, layer.kernel.rho.mean().item(), 0.5)
    return Surrogate(network, dataset.geometry, description)


def nodal(dataset: Dataset, count: int) -> Array:
    """Forces of the first test samples, (count, n_nodes, d); the mesh is in grid order."""
    force: Array = dataset.test.force[:count].double().flatten(2).numpy()
    return force.swapaxes(1, 2)


@pytest.fixture(params=[2, 3])
def samples(request: pytest.FixtureRequest, dataset: Dataset, dataset_3d: Dataset) -> Dataset:
    return {2: dataset, 3: dataset_3d}[request.param]


@torch.no_grad()
def outputs_of(model: Surrogate, force: Tensor, passes: range, seed: int = 0) -> Prediction:
    """Fields (passes, N, d, nx, ny[, nz]) of some passes, done at once."""
    stochastic = Passes(model.network)
    with stochastic.drawn(seed, passes):
        mean, std = model.network(force.repeat(len(passes), *[1] * (force.ndim - 1)))
    return Prediction(*(f.unflatten(0, (len(passes), len(force))) for f in (mean, std)))


def test_passes_done_at_once_are_each_as_by_itself(samples: Dataset) -> None:
    """Three passes of three samples in one batch, and passes 3, 4 and 7 one by one."""
    model, force = untrained(samples), samples.test.force[:3]
    at_once = outputs_of(model, force, range(3, 8))
    for number in (3, 4, 7):
        alone = outputs_of(model, force, range(number, number + 1))
        for field, expected in zip(at_once, alone, strict=True):
            assert field is not None
            assert expected is not None
            torch.testing.assert_close(field[number - 3], expected[0], rtol=1e-4, atol=1e-6)
    assert at_once.mean.std(dim=0).max() > 1e-2


def test_weights_of_a_pass_are_a_function_of_seed_and_number(dataset: Dataset) -> None:
    """Bit for bit, whatever other passes there are."""
    seen: list[Tensor] = []

    class Recorder(nn.Module):
        fixed = None

        def draw(self, generators: Any) -> tuple[Tensor]:
            seen.append(torch.stack([torch.randn(4, generator=g) for g in generators]))
            return (seen[-1],)

    passes = Passes(Recorder())
    for seed, numbers in ((5, range(4)), (5, range(2, 3)), (5, range(2, 9)), (6, range(4))):
        passes.draw(seed, numbers)
    assert torch.equal(seen[1][0], seen[0][2])
    assert torch.equal(seen[2][:2], seen[0][2:])
    assert len({tuple(row.tolist()) for row in torch.cat((seen[0], seen[3]))}) == 8


def test_passes_stay_drawn() -> None:
    """Until others are asked for, or they are forgotten: four draws of six are new."""
    draws: list[int] = []

    class Counter(nn.Module):
        fixed = None

        def draw(self, generators: Any) -> tuple[()]:
            draws.append(len(generators))
            return ()

    passes = Passes(Counter())
    for seed, number in ((0, 3), (0, 3), (1, 3), (1, 4), (1, 4)):
        passes.draw(seed, range(number))
    passes.forget()
    passes.draw(1, range(4))
    assert draws == [3, 3, 4, 4]


def test_every_layer_is_drawn_and_forgotten(dataset: Dataset) -> None:
    """Two convolutions at each of 2 + 1 levels; after that the mean weights are back."""
    model, force = untrained(dataset), dataset.test.force[:2]
    layers = drawables(model.network)
    assert len(layers) == 6
    assert all(isinstance(layer, Drawable) for layer in layers)
    with torch.no_grad():
        before = model.network(force).mean
        outputs_of(model, force, range(3))
        assert torch.equal(model.network(force).mean, before)
    assert drawables(nn.Conv2d(1, 1, 3)) == []


def assert_close(found: Distribution, expected: Distribution) -> None:
    for name, field in expected.fields().items():
        np.testing.assert_allclose(found.fields()[name], field, rtol=1e-4, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("batch", [1, 2, 7, 33, 64])
def test_distribution_does_not_depend_on_chunks(
    samples: Dataset, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    """11 passes of 3 samples at once, or as few at a time as the batch has room for."""
    model, forces = untrained(samples), nodal(samples, 3)
    expected = model.predict_distribution(forces, passes=11)
    monkeypatch.setattr(batched_prediction, "BATCH", batch)
    assert_close(model.predict_distribution(forces, passes=11), expected)


def test_distribution_by_hand(samples: Dataset) -> None:
    """Five passes: mean, standard deviation with T - 1, and root mean square of their σ."""
    model, forces = untrained(samples), nodal(samples, 3)
    fields = outputs_of(model, samples.test.force[:3], range(5), seed=9)
    mean, std = (f.double().flatten(3).swapaxes(2, 3).numpy() for f in fields if f is not None)
    expected = Distribution(mean.mean(0), mean.std(0, ddof=1), np.sqrt((std**2).mean(0)))
    found = model.predict_distribution(forces, passes=5, seed=9)
    assert_close(found, expected)
    np.testing.assert_allclose(
        found.std**2, found.std_epistemic**2 + found.std_aleatoric**2, rtol=1e-12
    )


def plain_network(model: Surrogate, dataset: Dataset) -> tuple[FieldNetwork, Callable[[], None]]:
    """The same network of plain convolutions, and what sets its weights to a new sample."""
    dimension = dataset.geometry.dimension
    config = model.description.run
    assert isinstance(config, UNetModel)
    unet = UNet(dimension, 2 * dimension, config.network)
    plain = FieldNetwork(unet, dataset.geometry, dataset.info).eval()
    plain.load_state_dict(model.network.state_dict(), strict=False)
    pairs = [
        (layer, plain.get_submodule(name))
        for name, layer in model.network.named_modules()
        if isinstance(layer, FlipoutConvolution)
    ]

    @torch.no_grad()
    def sample() -> None:
        for layer, convolution in pairs:
            assert isinstance(layer.bias, GaussianParameter)
            for parameter, name in ((layer.kernel, "weight"), (layer.bias, "bias")):
                weights = torch.normal(parameter.mean, parameter.std)
                convolution.get_parameter(name).copy_(weights)

    return plain, sample


def test_distribution_is_that_of_independent_weights(samples: Dataset) -> None:
    """Plain networks, weights set anew for each of 1000: within five standard errors everywhere.

    Standard errors of the means, of their variance and of the mean variance σ² follow from second
    and fourth moments; two estimates differ by √2 more.
    """
    model, force = untrained(samples, levels=1), samples.test.force[:1]
    plain, sample = plain_network(model, samples)
    torch.manual_seed(0)
    means, variances = [], []
    with torch.no_grad():
        for _ in range(DRAWS):
            sample()
            mean, std = plain(force)
            means.append(mean.flatten(2)[0])
            variances.append(std.square().flatten(2)[0])
    free = ~model.geometry.clamped
    mean, variance = (torch.stack(f).double().numpy()[:, :, free] for f in (means, variances))
    found = model.predict_distribution(nodal(samples, 1), passes=DRAWS)
    bound = 5 * math.sqrt(2 / DRAWS)

    deviation, variance_of_means = mean - mean.mean(0), mean.var(0)
    assert (np.abs(found.mean[0, free].T - mean.mean(0)) < bound * np.sqrt(variance_of_means)).all()
    error = np.sqrt((deviation**4).mean(0) - variance_of_means**2)
    assert (np.abs(found.std_epistemic[0, free].T ** 2 - variance_of_means) < bound * error).all()
    assert np.median(bound * error / variance_of_means) < 0.6
    average, error = variance.mean(0), variance.std(0)
    assert (np.abs(found.std_aleatoric[0, free].T ** 2 - average) < bound * error).all()


def test_passes_are_independent(dataset: Dataset) -> None:
    """The variance of a mean of T = 128 passes is 1/T of a pass's: within 30 % over 100 means.

    A Flipout batch of the same load 128 times is no such thing: its perturbations share their
    size, and its mean varies more than twice as much.
    """
    model, force = untrained(dataset, levels=1), dataset.test.force[:1]
    passes, repeats = 128, 100
    one_by_one = outputs_of(model, force, range(passes * repeats)).mean[:, 0, :, 1:]
    expected = one_by_one.var(0) / passes

    def ratio(means: Tensor) -> float:
        return float((means.var(0) / expected).mean())

    assert ratio(one_by_one.reshape(repeats, passes, *expected.shape).mean(1)) == pytest.approx(
        1, abs=0.3
    )
    for layer in flipouts(model.network):
        layer.train()
    torch.manual_seed(0)
    with torch.no_grad():
        batch = force.repeat(passes, 1, 1, 1)
        shared = torch.stack([model.network(batch).mean.mean(0)[:, 1:] for _ in range(repeats)])
    assert ratio(shared) > 2


def test_as_many_passes_at_once_as_there_is_memory_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Second convolutions of 2 levels of 8 and 16 channels: 9 · (2 · 8² + 16²) = 3456 weights."""
    network = UNet(2, 4, UNetConfig(levels=2, channels=8), VariationalConvolutions())
    monkeypatch.setattr("surrogate.learning.probabilistic.stochastic_passes.DRAWN", 3456 * 5 + 1)
    assert Passes(network).at_once == 5
    monkeypatch.setattr("surrogate.learning.probabilistic.stochastic_passes.DRAWN", 1)
    assert Passes(network).at_once == 1


def test_passes_may_take_a_quarter_of_the_free_memory_of_a_gpu(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """100 GB of free memory: 25 GB are 6.25e9 weights; a gigabyte at least, as on a CPU."""
    for free, weights in {100 * 10**9: 6_250_000_000, 10**9: 2**28}.items():
        monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _, free=free: (free, 2 * free))
        assert most_weights(torch.device("cuda")) == weights
    assert most_weights(torch.device("cpu")) == 2**28
