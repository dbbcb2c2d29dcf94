"""The loss of probabilistic networks compared with the paper's, and their training."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.probabilistic.flipout import VariationalConvolutions, flipouts
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.likelihoods import EvidenceLowerBound, Prediction
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.trainer import Trainer

CPU = torch.device("cpu")
MakeConfig = Callable[..., UNetModel]


def trainer_of(config: TrainedModel, dataset: Dataset) -> Trainer:
    network = config.build(dataset.geometry, dataset.info)
    return Trainer(config, network.train(), dataset.train, dataset.test)


def summed_likelihood(dataset: Dataset, prediction: Prediction, reference: Tensor) -> float:
    """Return -Σ Σ ln N(u; μ, σ²) over samples and free components, in nats, densities in 1/m."""
    free = torch.from_numpy(~dataset.geometry.clamped)  # the mesh is in grid order
    assert prediction.std is not None
    mean, std, u = (
        field.double().flatten(2)[:, :, free]
        for field in (prediction.mean, prediction.std, reference)
    )
    normal: Any = Normal(mean, std)
    return float(-normal.log_prob(u).sum())


def posteriors(trainer: Trainer) -> list[GaussianParameter]:
    return [
        parameter
        for layer in flipouts(trainer.network)
        for parameter in (layer.kernel, layer.bias)
        if isinstance(parameter, GaussianParameter)
    ]


@pytest.mark.parametrize("biases", [False, True])
@pytest.mark.parametrize("prior_mean", ["trainable", "zero"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_loss_is_the_papers(
    dataset: Dataset,
    dataset_3d: Dataset,
    make_config: MakeConfig,
    dimension: int,
    prior_mean: str,
    biases: bool,
) -> None:
    """Eq. ELBO_expand of Deshpande et al. (2022) from a batch of 8 of N = 48 samples.

    N·F·loss = N/8 · Σ NLL + KL[q|p] − N·F·ln(unit); the last term occurs because the loss measures
    lengths in units. F is the number of components of the free nodes: 28 of 32 nodes in 2D, 112 of
    128 in 3D.
    """
    samples = {2: dataset, 3: dataset_3d}[dimension]
    config = make_config(
        dimension=dimension,
        likelihood="variational_bayes",
        variational={"prior_mean": prior_mean, "biases": biases, "prior_std": 0.3},
    )
    trainer = trainer_of(config, samples)
    for parameter in posteriors(trainer):  # change the means, which start at the prior means
        torch.nn.init.normal_(parameter.mean, std=0.1)
        torch.nn.init.normal_(parameter.rho, mean=-3.0, std=0.5)
    batch = samples.train[torch.arange(8)]
    assert trainer.elbo is not None
    trainer.elbo.factor.fill_(1.0)
    torch.manual_seed(1)
    loss, likelihood, divergence = trainer.differentiate(batch, len(batch)).double().tolist()

    torch.manual_seed(1)
    with torch.no_grad():
        nll = summed_likelihood(samples, trainer.network(batch.force), batch.displacement)
    kl = sum(
        float(kl_divergence(Normal(p.mean, p.std), Normal(p.prior_mean, 0.3)).sum().detach())
        for p in posteriors(trainer)
    )
    count = 48 * dimension * {2: 28, 3: 112}[dimension]
    units = count * math.log(trainer.network.displacement_rms.item())
    assert count * likelihood + units == pytest.approx(48 / 8 * nll, rel=1e-4)
    assert count * divergence == pytest.approx(kl, rel=1e-4)
    assert count * loss + units == pytest.approx(48 / 8 * nll + kl, rel=1e-4)
    assert min(abs(48 / 8 * nll), kl) > 1e-2 * max(abs(48 / 8 * nll), kl)


def test_maximum_likelihood_loss_is_the_papers(dataset: Dataset, make_config: MakeConfig) -> None:
    """Eq. MLE_loss is the same without the KL divergence of the weights."""
    trainer = trainer_of(make_config(likelihood="maximum_likelihood"), dataset)
    batch = dataset.train[torch.arange(8)]
    (loss,) = trainer.differentiate(batch, len(batch)).double().tolist()
    with torch.no_grad():
        nll = summed_likelihood(dataset, trainer.network(batch.force), batch.displacement)
    units = math.log(trainer.network.displacement_rms.item())
    assert loss + units == pytest.approx(nll / (8 * 56), rel=1e-4)


def test_divergence_of_an_ensemble_is_the_mean_of_its_members(
    dataset: Dataset, make_config: MakeConfig
) -> None:
    """It is half of the sum for two members, because the loss is the mean of their losses."""
    config = make_config(likelihood="variational_bayes").model_copy(update={"ensemble": 2})
    trainer = trainer_of(config, dataset)
    for parameter in posteriors(trainer):
        torch.nn.init.normal_(parameter.mean, std=0.1)
    with torch.no_grad():
        kl = sum(
            kl_divergence(Normal(p.mean, p.std), Normal(p.prior_mean, 0.1)).sum()
            for p in posteriors(trainer)
        )
        assert len(posteriors(trainer)) == 2 * 3
        assert trainer.elbo is not None
        torch.testing.assert_close(trainer.elbo.kl_divergence(), kl / 2 / (48 * 56))


def test_sampled_divergence_averages_to_the_closed_one(
    dataset: Dataset, make_config: MakeConfig
) -> None:
    """The mean over 200 perturbations is within four standard errors of the closed form."""

    def bound(divergence: str) -> tuple[Trainer, EvidenceLowerBound]:
        trainer = trainer_of(
            make_config(
                likelihood="variational_bayes",
                variational={"kl_divergence": divergence, "biases": True, "initial_std": 0.08},
            ),
            dataset,
        )
        assert trainer.elbo is not None
        return trainer, trainer.elbo

    (trainer, sampled), force = bound("sampled"), dataset.train.force[:1]
    torch.manual_seed(0)
    found = []
    with torch.no_grad():
        for _ in range(200):
            trainer.network(force)
            found.append(float(sampled.kl_divergence()))
        closed = float(bound("closed")[1].kl_divergence())
    values = torch.tensor(found)
    assert abs(values.mean().item() - closed) < 4 * values.std().item() / math.sqrt(200)
    assert values.std() > 0


@pytest.mark.parametrize("weight", [1.0, 0.5])
def test_divergence_grows_over_the_warm_up(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig, weight: float
) -> None:
    """Ten epochs of one step; in the first four, the warm-up, the factor is 1/4, 1/2, 3/4, 1."""
    config = make_config(
        epochs=10,
        batch_size=64,
        likelihood="variational_bayes",
        variational={"warmup": 0.4, "weight": weight},
    )
    run = RunFolder(tmp_path / "run")
    train(config, dataset, run.folder, device="cpu")
    found = [
        (line["train_loss"] - line["negative_log_likelihood"]) / line["kl_divergence"]
        for line in run.metric_lines()
    ]
    expected = [weight * factor for factor in (0.25, 0.5, 0.75, *[1.0] * 7)]
    assert found == pytest.approx(expected, rel=1e-4)


LIKELIHOODS: list[Any] = [
    pytest.param({"likelihood": "deterministic"}, id="deterministic"),
    pytest.param({"likelihood": "maximum_likelihood"}, id="maximum_likelihood"),
    pytest.param({"likelihood": "maximum_likelihood", "beta": 0.5}, id="beta"),
    pytest.param({"likelihood": "variational_bayes"}, id="closed"),
    pytest.param(
        {
            "likelihood": "variational_bayes",
            "variational": {"kl_divergence": "sampled", "biases": True, "prior_mean": "zero"},
        },
        id="sampled",
    ),
]


def test_prior_means_are_trained_if_they_are_to_be(
    tmp_path: Path, dataset: Dataset, make_config: MakeConfig
) -> None:
    """Trainable prior means end between their start and the means; others stay at zero."""
    for prior_mean in ("trainable", "zero"):
        config = make_config(
            epochs=2, likelihood="variational_bayes", variational={"prior_mean": prior_mean}
        )
        run = RunFolder(tmp_path / prior_mean)
        train(config, dataset, run.folder, device="cpu")
        start = config.build(dataset.geometry, dataset.info).state_dict()
        end = load_file(run.model)
        name = "network.encoder.0.2.kernel."
        moved = end[f"{name}prior_mean"] - start[f"{name}prior_mean"]
        assert bool(moved.any()) == (prior_mean == "trainable")
        assert bool((end[f"{name}rho"] != start[f"{name}rho"]).all())


def test_validation_is_of_the_mean_weights(dataset: Dataset, make_config: MakeConfig) -> None:
    trainer = trainer_of(make_config(likelihood="variational_bayes"), dataset)
    torch.manual_seed(0)
    first = trainer.validate()
    torch.manual_seed(1)
    assert trainer.validate() == first


@pytest.mark.parametrize("prior_mean", ["trainable", "zero"])
def test_parameters_of_the_paper(prior_mean: str) -> None:
    """The network with three levels and c = 128 has 15.2 M parameters; deterministic 7.53 M.

    The second convolutions are probabilistic: their kernels have a mean, ρ and a prior mean for
    each of the 9 · (128² + 256² + 512² + 256² + 128²) = 3 833 856 weights. The last convolution has
    twice the outputs, which adds 2 · 128 + 2 parameters. The paper states 15.1 M.
    """
    config = VariationalConvolutions.model_validate({"prior_mean": prior_mean})
    with torch.device("meta"):
        deterministic = parameter_count(UNet(2, 2, UNetConfig()))
        found = parameter_count(UNet(2, 4, UNetConfig(), config))
    assert deterministic == 7530498
    extra = {"trainable": 2, "zero": 1}[prior_mean]
    assert found == deterministic + extra * 3833856 + 258
    if prior_mean == "trainable":
        assert round(found / 1e6, 1) == 15.2
