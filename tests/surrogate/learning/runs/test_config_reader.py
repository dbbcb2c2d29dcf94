from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from shared_schema.common.errors import InputError
from surrogate.learning.models.training_config import DeterministicTraining
from surrogate.learning.runs.config_reader import read_config
from tests.surrogate.unet_configs import shipped_unet

PLAIN = "name: a\ncase: b\n"
MLE = "name: a\ncase: b\nlikelihood: maximum_likelihood"
BAYES = "name: a\ncase: b\nlikelihood: variational_bayes\nvariational"


def test_recipe_of_the_paper() -> None:
    """Deshpande et al. (2022), Section 3: Adam at 1e-4, batches of 4, 600 epochs, c = 128."""
    config = shipped_unet("beam2d-det-paper")
    assert isinstance(config.training, DeterministicTraining)
    assert config.training.optimiser.name == "adam"
    assert config.training.optimiser.learning_rate == 1e-4
    assert (config.training.batch_size, config.training.epochs) == (4, 600)
    assert config.training.loss == "mse"
    assert config.network.level_channels() == [128, 256, 512]
    assert config.network.batch_norm


def test_round_trip_through_yaml(tmp_path: Path) -> None:
    config = read_config("beam2d-det-fast")
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump(config.plain()))
    assert read_config(str(path)) == config


def test_unknown_name_lists_those_shipped() -> None:
    with pytest.raises(InputError, match=r"config 'beam4d': .*beam2d-det-fast"):
        read_config("beam4d")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("name: a", "key 'case' is missing"),
        ("name: a\ncase: b\nepochs: 3", "unknown key 'epochs'"),
        ("name: a\ncase: b\ntraining: {epochs: 0}", "key 'training.epochs' = 0"),
        ("name: a\ncase: b\nnetwork: {levels: 2, depth: 3}", "unknown key 'network.depth'"),
        ("name: a\ncase: b\ntraining: {optimiser: {name: sgd}}", "'training.optimiser.name'"),
        ("name: a\ncase: b\ntraining: {validation_fraction: 1}", "'training.validation_fraction'"),
        ("name: a\ncase: b\nlikelihood: uniform", "found (model unet, likelihood uniform)"),
        (f"{BAYES}: {{prior_mean: fitted}}", "key 'variational.prior_mean' = 'fitted'"),
        (f"{BAYES}: {{convolutions: [3]}}", "key 'variational.convolutions.0' = 3"),
        (f"{BAYES}: {{levels: [0, 3]}}", "'variational.levels' = [0, 3]"),
        (f"{MLE}\ntraining: {{beta: 1.1}}", "key 'training.beta' = 1.1"),
        (f"{PLAIN}training: {{optimiser: {{learning_rate: 1e308}}}}", "learning_rate' = 1e+308"),
        (f"{PLAIN}training: {{optimiser: {{betas: [1, 1]}}}}", "'training.optimiser.betas.0' = 1"),
        (f"{PLAIN}training: {{epochs: {10**30}}}", "key 'training.epochs' = 1"),
        (f"{PLAIN}network: {{channels: 1000000}}", "key 'network.channels' = 1000000"),
        (f"{PLAIN}network: {{levels: 10, channels: 128, multiplier: 3}}", "2519424 channels at"),
        (f"{PLAIN}seed: {2**63}", f"key 'seed' = {2**63}"),
    ],
)
def test_wrong_key_is_named(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_config(str(path))
    assert str(error.value).startswith(f"{path}: ")
    assert part in str(error.value)
