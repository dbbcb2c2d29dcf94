"""Training in one go and in two, which must come to the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file

from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.model import Model
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train

CPU = torch.device("cpu")
TIMES = ("seconds", "samples_per_second")


def trained(config: Model, dataset: Dataset, folder: Path) -> RunFolder:
    """A run, trained to its end."""
    run = RunFolder(folder)
    train(config, dataset, run.folder, device="cpu")
    return run


def untimed(run: RunFolder) -> list[dict[str, Any]]:
    """Its lines of measures, without the times."""
    return [{k: v for k, v in line.items() if k not in TIMES} for line in run.metric_lines()]


def assert_resumes(config: Model, dataset: Dataset, folder: Path, stop_after: int) -> None:
    """Model, checkpoint and measures are the same bit for bit with a stop on the way."""
    whole, parts = trained(config, dataset, folder / "whole"), RunFolder(folder / "parts")
    train(config, dataset, parts.folder, device="cpu", stop_after=stop_after)
    assert not parts.model.is_file()
    train(config, dataset, parts.folder, device="cpu")
    assert whole.model.read_bytes() == parts.model.read_bytes()
    one, other = load_file(whole.checkpoint), load_file(parts.checkpoint)
    assert list(one) == list(other)
    for name in one:
        assert torch.equal(one[name], other[name]), name
    assert untimed(whole) == untimed(parts)
