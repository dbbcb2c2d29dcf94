"""The folder of a run: configuration, weights, measures. No file in it is a pickle.

::

    config.yaml         resolved configuration, and the dataset of the training
    model.safetensors   weights, scales, mesh and grid map
    metrics.jsonl       one line per epoch
    hardware.txt        name of the hardware of the training
    evaluation.json     errors on the test split
    intervals.safetensors   factors of conformal intervals (with `evaluate --conformal`)
    figures/            figures
    checkpoint/         last.safetensors, to resume from
    tensorboard/        event files of TensorBoard (with `train --tensorboard`)
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml
from torch import Tensor

from shared_schema.common.atomic_file import write_text
from shared_schema.common.configuration import read_yaml, validate
from shared_schema.common.errors import InputError
from surrogate.runs.description import RunDescription
from surrogate.runs.tensor_file import load_tensors, save_atomically


class RunFolder:
    """Paths and files of one run.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.config = folder / "config.yaml"
        self.model = folder / "model.safetensors"
        self.metrics = folder / "metrics.jsonl"
        self.hardware = folder / "hardware.txt"
        self.evaluation = folder / "evaluation.json"
        self.intervals = folder / "intervals.safetensors"
        self.figures = folder / "figures"
        self.checkpoint = folder / "checkpoint" / "last.safetensors"
        self.tensorboard = folder / "tensorboard"

    def start(self, description: RunDescription) -> None:
        """Make the folder, or require that it belongs to the same configuration and dataset.

        Raises
        ------
        InputError
            If the folder belongs to another run (the message names the first difference) or holds
            other files.
        """
        if self.config.is_file():
            existing = self.description()
            if existing.data.loads is None:
                description = description.as_before_loads()
            if existing != description:
                raise InputError(
                    f"--out '{self.folder}': a run with another "
                    f"{first_difference(existing.model_dump(), description.model_dump())}"
                )
            return
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise InputError(f"--out '{self.folder}': holds something else, expected a new folder")
        self.folder.mkdir(parents=True, exist_ok=True)
        content = description.model_dump(mode="json")
        write_text(self.config, yaml.safe_dump(content, sort_keys=False))

    def description(self) -> RunDescription:
        """Read ``config.yaml``; InputError if it is missing or damaged."""
        if not self.config.is_file():
            raise InputError(f"{self.folder}: no run there, expected a folder with config.yaml")
        return validate(RunDescription, read_yaml(self.config), str(self.config))

    def read_tensors(self) -> dict[str, Tensor]:
        """Read ``model.safetensors``; InputError if the run is not finished or damaged."""
        if not self.model.is_file():
            raise InputError(f"{self.folder}: the run is not finished, no {self.model.name} in it")
        return load_tensors(self.model)[0]

    def write_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Write ``model.safetensors`` atomically."""
        save_atomically(tensors, self.model)

    def trained_on(self) -> str:
        """Return the name of the hardware of the training; "unknown" if the file is missing."""
        return self.hardware.read_text().strip() if self.hardware.is_file() else "unknown"

    def metric_lines(self) -> list[dict[str, Any]]:
        """Read every complete line of ``metrics.jsonl``; an incomplete last line is left out."""
        if not self.metrics.is_file():
            return []
        lines = []
        for text in filter(None, self.metrics.read_text().splitlines()):
            try:
                lines.append(json.loads(text))
            except ValueError:
                break
        return lines

    def training_effort(self) -> tuple[int, float]:
        """Return epochs and seconds of the training; those of the evaluation if it has no lines."""
        if lines := self.metric_lines():
            return lines[-1]["epoch"], lines[-1]["seconds"]
        if not self.evaluation.is_file():
            return 0, 0.0
        evaluation = self.read_evaluation()
        return evaluation["epochs"], evaluation["training_seconds"]

    def keep_metric_lines(self, epoch: int) -> None:
        """Delete the lines of epochs after `epoch`."""
        lines = [line for line in self.metric_lines() if line["epoch"] <= epoch]
        write_text(self.metrics, "".join(json.dumps(line) + "\n" for line in lines))

    def read_evaluation(self) -> dict[str, Any]:
        """Read ``evaluation.json``; InputError if it is missing or damaged."""
        if not self.evaluation.is_file():
            raise InputError(f"{self.folder}: not evaluated yet, no {self.evaluation.name} in it")
        try:
            content: dict[str, Any] = json.loads(self.evaluation.read_text())
        except ValueError as error:
            raise InputError(f"{self.evaluation}: damaged ({error})") from None
        return content


def first_difference(old: Any, new: Any, key: str = "") -> str:
    """Describe the first difference of two nested mappings: ``key = new, the folder has old``."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(k for k in new if k not in old)]:
            if old.get(name) != new.get(name):
                return first_difference(old.get(name), new.get(name), f"{key}.{name}".strip("."))
    return f"{key} = {new!r}, the folder has {old!r}"
