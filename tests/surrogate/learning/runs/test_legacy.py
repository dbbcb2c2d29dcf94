"""Run folders of version 1 give the same model, and training resumes in them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from safetensors.torch import save

from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.model import Model
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.config_reader import read_config
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train
from surrogate.runtime.tensor_file import TENSOR_DIGEST, load_tensors, tensor_digest
from tests.surrogate.resuming import trained
from tests.surrogate.unet_configs import unet_config

CPU = torch.device("cpu")
SPELLED_OUT: dict[str, Any] = {  # by version 1, for every kind of model
    "model": "unet",
    "likelihood": "deterministic",
    "network": {
        "levels": 3,
        "channels": 128,
        "multiplier": 2,
        "padding": 2,
        "activation": "relu",
        "batch_norm": True,
        "inputs": ["linear"],
        "dropout": 0.0,
    },
    "pod": None,
    "ensemble": 1,
    "variational": None,
}
POD = {"energy": 1 - 1e-8, "rank": None, "degree": 6, "penalty": 1e-8, "gp_samples": 2000}
TRAINING: dict[str, Any] = {
    "epochs": 600,
    "batch_size": 4,
    "optimiser": {"name": "adam", "momentum": 0.95, "rho_factor": 1.0},
    "schedule": {"name": "constant", "warmup": 0.0, "final": 0.0},
    "loss": "mse",
    "beta": 0.0,
    "validation_fraction": 0.0,
    "recalibrate": False,
    "calibration_fraction": 0.0,
    "early_stopping": None,
    "ema": None,
    "precision": "float32",
    "compile": False,
    "cuda_graphs": False,
    "checkpoint_seconds": 60.0,
}


def as_version_1(config: Model) -> dict[str, Any]:
    """Return the configuration in version 1: all keys of all models, with their old names."""
    content = SPELLED_OUT | config.plain()
    network = dict(content["network"])
    network["inputs"] = network.pop("force_transforms", ["linear"])
    network.pop("skip", None)
    content["network"] = network
    content["training"] = TRAINING | content["training"]
    content["training"]["residency"] = content["training"].pop("samples_on", "auto")
    if content["pod"] is not None:
        content["pod"] = POD | content["pod"]
    if content["variational"] is not None:
        names = {"kl_divergence": "divergence", "posterior_std": "spread"}
        content["variational"] = {
            names.get(key, key): value for key, value in content["variational"].items()
        }
    return content


def turn_into_version_1(run: RunFolder) -> None:
    """Rewrite a run folder in the form of version 1: no manifest, no checksums of lines."""
    lines = run.metric_lines()
    run.seal.path.unlink()
    run.metrics.write_text("".join(json.dumps(line) + "\n" for line in lines))
    content = yaml.safe_load(run.config.read_text())
    del content["version"]
    content["run"] = as_version_1(run_config(content["run"]))
    run.config.write_text(yaml.safe_dump(content, sort_keys=False))
    for path in (run.model, run.checkpoint):
        if path.is_file():
            tensors, metadata = load_tensors(path)
            renamed = {
                name.replace("displacement_rms", "unit").replace("posterior_std.", "spreads."): t
                for name, t in tensors.items()
            }
            text = {**metadata, TENSOR_DIGEST: tensor_digest(renamed, {})}
            path.write_bytes(save(renamed, text))


@pytest.mark.parametrize("name", ["det", "mle", "vb", "linear", "pod", "gp", "ensemble"])
def test_configurations_come_back(name: str, dataset: Dataset, tmp_path: Path) -> None:
    run, config = RunFolder(tmp_path), read_config(f"beam2d-{name}-fast")
    data = {
        "case": {},
        "digest": "",
        "dimension": 2,
        "cell_type": "quad",
        "info": dataset.info.model_dump(mode="json"),
    }
    run.config.write_text(yaml.safe_dump({"run": as_version_1(config), "data": data}))
    assert run.description().run == config


@pytest.mark.parametrize(
    "options",
    [
        {"ema": 0.9, "early_stopping": {"patience": 2}},
        {"likelihood": "variational_bayes", "variational": {"posterior_std": "gauss_newton"}},
    ],
    ids=["average", "gauss-newton"],
)
def test_prediction_and_resume(
    tmp_path: Path,
    dataset: Dataset,
    make_config: Callable[..., UNetModel],
    options: dict[str, Any],
) -> None:
    config = make_config(epochs=4, **options)
    whole = trained(config, dataset, tmp_path / "whole")
    expected = load(whole.folder).predict(dataset.nodal_test.force)
    halves = RunFolder(tmp_path / "halves")
    train(config, dataset, halves.folder, device="cpu", stop_after=2)
    turn_into_version_1(halves)
    train(config, dataset, halves.folder, device="cpu")
    turn_into_version_1(whole)
    for run in (whole, halves):
        assert np.array_equal(load(run.folder).predict(dataset.nodal_test.force), expected)


def test_inputs_that_no_member_took_are_dropped(dataset: Dataset, tmp_path: Path) -> None:
    """Version 1 accepted configurations with more inputs than networks."""
    run = trained(unet_config(case="beam2d", training={"epochs": 1}), dataset, tmp_path)
    run.seal.path.unlink()
    content = yaml.safe_load(run.config.read_text())
    del content["version"]
    content["run"]["network"]["inputs"] = ["linear", "asinh"]
    del content["run"]["network"]["force_transforms"], content["run"]["network"]["skip"]
    run.config.write_text(yaml.safe_dump(content))
    config = run.description().run
    assert isinstance(config, UNetModel)
    assert config.network.force_transforms == ("linear",)


def test_a_wrong_key_of_today_is_no_key_of_then(dataset: Dataset, tmp_path: Path) -> None:
    run = trained(unet_config(case="beam2d", training={"epochs": 1}), dataset, tmp_path)
    run.seal.path.unlink()
    content = yaml.safe_load(run.config.read_text())
    content["run"]["pod"] = None
    run.config.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=r"unknown key 'run\.pod'"):
        run.description()
