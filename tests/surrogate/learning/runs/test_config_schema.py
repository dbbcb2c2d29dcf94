"""The keys of configurations: every one has a meaning; the schema accepts what is accepted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from shared_schema.common.configuration import read_yaml
from surrogate.command_line import main
from surrogate.learning.runs.config_reader import (
    SHIPPED,
    config_keys,
    config_schema,
    named,
    read_recipe,
)

SCHEMA = config_schema()
KEYS = config_keys()


def test_every_key_has_a_meaning() -> None:
    assert [key.name for key in KEYS if not key.meaning] == []


def test_kinds_of_model_are_named() -> None:
    only = {key.name: key.only for key in KEYS}
    assert only["seed"] == ""
    assert only["network.levels"] == "model unet"
    assert only["training.epochs"] == "model unet, linear, reduced"
    assert only["training.beta"] == "model unet, reduced with maximum_likelihood, variational_bayes"
    assert only["training.loss"] == "model unet, reduced with deterministic; model linear"
    types = {key.name: key.type for key in KEYS}
    assert types["model"] == "unet | linear | pod | reduced | series"
    assert types["likelihood"] == "deterministic | maximum_likelihood | variational_bayes"
    names = [key.name for key in KEYS]
    assert names.index("training") < names.index("training.loss") < names.index("seed")


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_configurations_are_valid(path: Path) -> None:
    Draft202012Validator(SCHEMA).validate(named(read_yaml(path), "case", path.stem))


def test_wrong_configurations_are_not() -> None:
    validator, (content, _) = Draft202012Validator(SCHEMA), read_recipe("beam2d-det-fast")
    for change in (
        {"seed": -1},
        {"seeds": 1},
        {"model": "reduced"},  # its network has other keys
        {"training": {**content["training"], "beta": 0.5}},  # of a likelihood
    ):
        assert not validator.is_valid({**content, **change}), change


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "training.checkpoint_seconds"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("training.checkpoint_seconds: number ≥ 0, ≤ 1e+07 in s; default 60")
    assert main(["schema", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == SCHEMA
    assert main(["schema", "--format", "json", "seed"]) == 2
    assert main(["schema", "seeds"]) == 2
