"""Choosing a model in the configuration: what fits together, and one line for what does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from shared_schema.common.errors import InputError
from surrogate.runs.configuration import RunConfig, read_config

BASELINES = ("linear", "pod", "gp", "dropout", "ensemble")


def test_defaults_are_one_plain_unet() -> None:
    config = RunConfig(name="a", case="b")
    assert (config.model, config.pod, config.ensemble) == ("unet", None, 1)
    assert config.network.dropout == 0.0


@pytest.mark.parametrize("model", BASELINES)
def test_cases_differ_by_their_name_alone(model: str) -> None:
    beam, l_shape = (read_config(f"{case}-{model}-fast") for case in ("beam2d", "lshape2d"))
    renamed = beam.model_copy(update={"name": l_shape.name, "case": "lshape2d"})
    assert renamed == l_shape


@pytest.mark.parametrize("model", ["dropout", "ensemble"])
def test_networks_are_those_of_the_deterministic_recipe(model: str) -> None:
    config, plain = read_config(f"beam2d-{model}-fast"), read_config("beam2d-det-fast")
    assert config.training == plain.training
    assert config.network.model_copy(update={"dropout": 0.0}) == plain.network


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("model: tree", "key 'model' = 'tree'"),
        ("model: pod", "'pod' is missing, but 'model' is 'pod'"),
        ("pod: {}", "'pod' is given, but 'model' is 'unet'"),
        ("model: linear\npod: {}", "'pod' is given, but 'model' is 'linear'"),
        ("model: linear\nnetwork: {levels: 2}", "'network' is given, but 'model' is 'linear'"),
        ("model: linear\nensemble: 3", "'ensemble' is given, but 'model' is 'linear'"),
        ("ensemble: 0", "key 'ensemble' = 0"),
        ("network: {dropout: 1}", "key 'network.dropout' = 1"),
        ("model: pod\npod: {energy: 1}", "key 'pod.energy' = 1"),
        ("model: pod\npod: {regression: tree}", "key 'pod.regression' = 'tree'"),
        (
            "model: linear\nlikelihood: maximum_likelihood",
            "'likelihood' is 'maximum_likelihood', expected 'deterministic' of model 'linear'",
        ),
        (
            "model: pod\npod: {regression: gp}",
            "'likelihood' is 'deterministic', expected 'maximum_likelihood' of model 'pod' by 'gp'",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(f"name: a\ncase: b\n{text}")
    with pytest.raises(InputError) as error:
        read_config(str(path))
    assert part in str(error.value)
    assert "\n" not in str(error.value)
