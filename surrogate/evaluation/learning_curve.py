r"""The learning curve of a configuration: its error over the number of training samples.

Every training has as many steps as that on all samples, so that small numbers of samples are not at
a disadvantage. Over the numbers N that were tried, a power law is fitted to the mean errors by
least squares of the logarithms:

.. math:: \bar e(N) ≈ a \, N^{-b}
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from shared_schema.common.errors import InputError
from surrogate.evaluation.evaluate import evaluate
from surrogate.models.model import Model, TrainedModel
from surrogate.runs.folder import RunFolder
from surrogate.training.loop import train
from surrogate.training.setup import dataset_for

HALVINGS = 5  # numbers of samples, if none are given
FEWEST = 20  # samples of a training, if none are given
LARGEST_POWER = 100  # of e, in a number of samples


@dataclass(frozen=True)
class Point:
    """A training on some of the samples.

    Attributes
    ----------
    samples : int
        Number of samples, those for validation and calibration included.
    epochs : int or None
        Number of epochs; None for a model that is fitted directly.
    mean_error, std_error : float
        ē and σ(e) on the test split in m.
    minutes : float
        Time of the training in min.
    """

    samples: int
    epochs: int | None
    mean_error: float
    std_error: float
    minutes: float


@dataclass(frozen=True)
class PowerLaw:
    """Error over the number of samples, ē ≈ a N^(−b).

    Attributes
    ----------
    factor : float
        a in m.
    exponent : float
        b.
    """

    factor: float
    exponent: float

    @classmethod
    def of(cls, points: Sequence[Point]) -> PowerLaw:
        """Fit the law to two points at least."""
        samples, errors = (
            np.log([getattr(point, name) for point in points]) for name in ("samples", "mean_error")
        )
        slope, intercept = np.polyfit(samples, errors, 1)
        return cls(float(np.exp(intercept)), float(-slope))

    def error(self, samples: float) -> float:
        """Return ē in m for a number of samples."""
        return float(self.factor * samples**-self.exponent)

    def samples(self, error: float) -> float:
        """Return the number of samples for an error ē in m; infinite if more do not help."""
        if self.exponent <= 0:
            return math.inf
        power = math.log(self.factor / error) / self.exponent
        return math.exp(power) if power < LARGEST_POWER else math.inf


def default_counts(training: int) -> list[int]:
    """Return a number of training samples and its halves, ascending."""
    counts = {training // 2**halving for halving in range(HALVINGS)}
    return sorted(count for count in counts if count >= min(FEWEST, training))


def learning_curve(
    config: Model,
    data: Path,
    folder: Path,
    counts: Sequence[int],
    device: torch.device,
) -> list[Point]:
    """Train on growing numbers of samples, and evaluate on the test split of the dataset.

    Trainings that are there are not repeated; one that was stopped is resumed.

    Parameters
    ----------
    config : Model
    data : Path
        Structured dataset.
    folder : Path
        Folder of the runs: ``n100`` is that on the first 100 training samples.
    counts : sequence of int
        Numbers of training samples; if empty, all of them and halves of them.
    device : torch.device

    Raises
    ------
    InputError
        If there are fewer samples than a number asks for, or as `train` and `evaluate`.
    """
    dataset = dataset_for(config, data)
    total = len(dataset.training)
    counts = sorted(set(counts)) or default_counts(total)
    if counts[0] < 1 or counts[-1] > total:
        wrong = counts[0] if counts[0] < 1 else counts[-1]
        raise InputError(
            f"--samples {wrong}: expected 1 to {total}, the number of training samples of {data}"
        )
    points = []
    for count in counts:
        run = RunFolder(folder / f"n{count}")
        part = config_of(config, count, total)
        train(part, dataset, run.folder, device=device.type)
        test = evaluate(run.folder, data, device.type).measures
        epochs, seconds = run.training_effort()
        points.append(
            Point(
                samples=count,
                epochs=epochs if isinstance(part, TrainedModel) else None,
                mean_error=test.mean_error,
                std_error=test.std_error,
                minutes=seconds / 60,
            )
        )
    return points


def config_of(config: Model, count: int, total: int) -> Model:
    """Return the configuration of a training on `count` of `total` samples, with as many steps."""
    changes: dict[str, int] = {"samples": count}
    if isinstance(config, TrainedModel):
        changes["epochs"] = max(1, round(config.training.epochs * total / count))
    training = config.training.model_copy(update=changes)
    name = f"{config.name}-n{count}"
    return config.model_copy(update={"name": name, "recipe": "custom", "training": training})


def curve_as_json(config: Model, points: Sequence[Point], law: PowerLaw | None) -> str:
    """Return curve and power law as JSON."""
    content = {
        "config": config.plain(),
        "points": [asdict(point) for point in points],
        "power_law": None if law is None else asdict(law),
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"
