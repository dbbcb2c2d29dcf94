"""An estimate of a training beside the training itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import yaml

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.joined_dataset import read_dataset
from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.planning.trial_steps import dry_run
from surrogate.learning.runs.split import split_training

CPU = torch.device("cpu")


def test_sizes_are_those_of_the_training(
    dataset: Dataset, make_config: Callable[..., UNetModel]
) -> None:
    config = make_config(epochs=7)
    estimate = dry_run(config, dataset, device="cpu")
    train = len(split_training(dataset.training, config).train)
    free = torch.from_numpy(dataset.geometry.free_mask)
    assert estimate.samples == train
    assert estimate.steps == 7 * -(-train // config.training.batch_size)
    assert estimate.parameters == parameter_count(config.make_network(2, free))
    assert 1 <= estimate.timed <= 50
    assert estimate.minutes == pytest.approx(estimate.steps * estimate.seconds / 60)


def test_a_model_that_is_fitted_has_no_steps(data: Path) -> None:
    dataset = read_dataset(data)
    content = {"name": "pod", "case": dataset.manifest.name, "model": "pod", "pod": {}}
    with pytest.raises(InputError, match="dry_run: config 'pod' is fitted directly"):
        dry_run(run_config(content), dataset, device="cpu")


def test_command_writes_nothing(
    data: Path,
    tmp_path: Path,
    make_config: Callable[..., UNetModel],
    capsys: pytest.CaptureFixture[str],
) -> None:
    config, run = tmp_path / "small.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(make_config(epochs=2).plain()))
    command = ["train", str(config), "--data", str(data), "--out", str(run), "--dry-run"]
    assert main([*command, "--set", "training.epochs=9"]) == 0
    printed = capsys.readouterr().out
    assert "U-Net, " in printed
    assert "9 epochs, " in printed
    assert not run.exists()
