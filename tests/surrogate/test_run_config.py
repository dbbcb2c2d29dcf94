from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from shared_schema.errors import InputError
from surrogate.run_config import SHIPPED, RunConfig, read_config


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_configurations_are_valid_and_named_as_their_files(path: Path) -> None:
    config = read_config(path.stem)
    assert config.name == path.stem
    assert config.case == path.stem.split("-")[0]


def test_recipe_of_the_paper() -> None:
    """Deshpande et al. (2022), Section 3: Adam at 1e-4, batches of 4, 600 epochs, c = 128."""
    config = read_config("beam2d-det-paper")
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
        ("name: a\ncase: b\ntraining: {epochs: many}", "key 'training.epochs' = 'many'"),
        ("name: a\ncase: b\nnetwork: {levels: 2, depth: 3}", "unknown key 'network.depth'"),
        ("name: a\ncase: b\ntraining: {optimiser: {name: sgd}}", "'training.optimiser.name'"),
        ("name: a\ncase: b\ntraining: {validation_fraction: 1}", "'training.validation_fraction'"),
        ("name: a\ncase: b\nlikelihood: uniform", "key 'likelihood' = 'uniform'"),
    ],
)
def test_wrong_key_is_named(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_config(str(path))
    assert str(error.value).startswith(f"{path}: ")
    assert part in str(error.value)


def test_defaults_are_stored() -> None:
    plain = RunConfig(name="a", case="b").plain()
    assert plain["training"]["optimiser"]["betas"] == [0.9, 0.999]
    assert RunConfig.model_validate(plain) == RunConfig(name="a", case="b")
