from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.evaluation.run_evaluation import evaluate
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import Ensemble
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.learning.training.trainer import Trainer
from surrogate.learning.training.validation import loss_per_datum
from surrogate.runtime.tensor_file import load_tensors
from tests.surrogate.unet_configs import unet_config

CPU = torch.device("cpu")


def config_with(likelihood: str = "deterministic", members: int = 2, **network: Any) -> UNetModel:
    content: dict[str, Any] = {
        "name": "ensemble",
        "case": "beam2d",
        "likelihood": likelihood,
        "network": {"levels": 2, "channels": 8, "padding": 1, "batch_norm": False, **network},
        "ensemble": members,
        "training": {
            "epochs": 4,
            "batch_size": 16,
            "optimiser": {"name": "muon", "learning_rate": 5e-3},
            "validation_fraction": 0.1,
        },
    }
    return unet_config(**content)


def trained(folder: Path, dataset: Dataset, config: UNetModel) -> Surrogate:
    train(config, dataset, folder, device="cpu")
    return load(folder)


def test_one_member_after_the_other() -> None:
    members = [nn.Linear(3, 2), nn.Linear(3, 2)]
    x = torch.randn(5, 3)
    y = Ensemble(members)(x)
    assert torch.equal(y, torch.cat([members[0](x), members[1](x)]))


def member_of(run: Path, number: int, dataset: Dataset, folder: Path) -> Surrogate:
    """Write a member as a separate run and load it."""
    run_folder = RunFolder(folder)
    description = RunFolder(run).description()
    alone = description.run.model_copy(update={"ensemble": 1})
    run_folder.start(description.model_copy(update={"run": alone}))
    prefix, tensors = f"network.members.{number}.", load_tensors(RunFolder(run).model)[0]
    run_folder.write_tensors(
        {
            name.replace(prefix, "network."): value
            for name, value in tensors.items()
            if name.startswith(prefix) or not name.startswith("network.members.")
        }
    )
    return load(folder)


@pytest.mark.parametrize("likelihood", ["deterministic", "maximum_likelihood"])
def test_mean_and_standard_deviations_of_two_by_hand(
    tmp_path: Path, dataset: Dataset, likelihood: str
) -> None:
    """(a + b) / 2, |a − b| / √2, and √((σ_a² + σ_b²) / 2)."""
    whole = trained(tmp_path / "run", dataset, config_with(likelihood))
    force = dataset.nodal_test.force
    found = whole.predict_distribution(force)
    a, b = (
        member_of(tmp_path / "run", k, dataset, tmp_path / str(k)).averaged_passes(force)
        for k in range(2)
    )
    np.testing.assert_allclose(found.mean, (a.mean + b.mean) / 2, atol=1e-7)
    np.testing.assert_allclose(found.std_epistemic, np.abs(a.mean - b.mean) / np.sqrt(2), atol=1e-7)
    aleatoric = np.sqrt((a.std_aleatoric**2 + b.std_aleatoric**2) / 2)
    np.testing.assert_allclose(found.std_aleatoric, aleatoric, atol=1e-7)
    assert found.std_epistemic.max() > 1e-3
    assert bool(aleatoric.any()) == (likelihood == "maximum_likelihood")
    assert whole.is_probabilistic
    assert np.array_equal(whole.predict_distribution(force, passes=7).mean, found.mean)


def test_first_member_is_the_network_that_is_trained_alone(
    tmp_path: Path, dataset: Dataset
) -> None:
    """Muon and Adam are indifferent to the loss's factor of 1/2, up to Adam's ε and rounding."""
    trained(tmp_path / "run", dataset, config_with())
    member = member_of(tmp_path / "run", 0, dataset, tmp_path / "member")
    alone = trained(tmp_path / "alone", dataset, config_with(members=1))
    force = dataset.nodal_test.force
    largest = np.abs(alone.predict(force)).max()
    assert np.abs(member.predict(force) - alone.predict(force)).max() < 2e-3 * largest
    other = member_of(tmp_path / "run", 1, dataset, tmp_path / "other")
    assert np.abs(other.predict(force) - alone.predict(force)).max() > 2e-2 * largest


@pytest.mark.parametrize("likelihood", ["deterministic", "maximum_likelihood"])
def test_loss_and_error(dataset: Dataset, likelihood: str) -> None:
    """The loss is the mean of the members' losses, the error that of the mean of the members."""
    config = config_with(likelihood, members=3)
    network = config.build(dataset.geometry, dataset.info)
    network.node_fraction = 0.5
    trainer = Trainer(config, network, dataset.train, dataset.test)
    reference = dataset.test.displacement
    measures = trainer.validate()
    prediction = network(dataset.test.force)
    parts = [Prediction(*fields) for fields in zip(*(_thirds(f) for f in prediction), strict=True)]
    network.members = 1  # so that the trainer takes each of them for the only one
    losses = [loss_per_datum(config, network, part, dataset.test).item() for part in parts]
    assert measures["validation_loss"] == pytest.approx(np.mean(losses), rel=1e-5)
    mean = torch.stack([part.mean for part in parts]).mean(dim=0)
    error = (mean - reference).abs().mean().item() / 0.5
    assert measures["validation_error"] == pytest.approx(error, rel=1e-5)


def _thirds(field: Tensor | None) -> tuple[Tensor | None, ...]:
    return (None,) * 3 if field is None else field.chunk(3)


def test_k_and_k_epochs_are_2k(tmp_path: Path, dataset: Dataset) -> None:
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    train(config_with(), dataset, whole.folder, device="cpu")
    train(config_with(), dataset, parts.folder, device="cpu", stop_after=2)
    train(config_with(), dataset, parts.folder, device="cpu")
    assert whole.model.read_bytes() == parts.model.read_bytes()


def test_members_may_be_stochastic(tmp_path: Path, dataset: Dataset) -> None:
    """K · T passes; drawn again they are the same, with another seed they are others."""
    surrogate = trained(tmp_path / "run", dataset, config_with(dropout=0.2))
    force = dataset.nodal_test.force
    one, again, other = (surrogate.predict_distribution(force, 6, seed) for seed in (0, 0, 1))
    assert np.array_equal(one.std, again.std)
    assert not np.array_equal(one.std, other.std)


def test_evaluated(tmp_path: Path, dataset: Dataset, data: Path) -> None:
    one = config_with(members=1).build(dataset.geometry, dataset.info)
    trained(tmp_path / "run", dataset, config_with())
    content = evaluate(tmp_path / "run", data).content
    assert content["uncertainty"]["samples"] == len(dataset.test)
    assert content["trainable_parameters"] == 2 * parameter_count(one)
