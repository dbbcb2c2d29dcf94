"""The split of the training samples into training, validation and calibration samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar, cast

import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.models.model import Model
from surrogate.runtime.device import CALIBRATION, VALIDATION, stream

AnySamples = TypeVar("AnySamples", bound=Samples | SamplesOnDisk)


@dataclass(frozen=True)
class TrainingSplit(Generic[AnySamples]):
    """Disjoint random subsets of the training samples; each subset keeps the samples' order.

    Attributes
    ----------
    train : Samples or SamplesOnDisk
        Samples that the weights are fitted to.
    validation : Samples or SamplesOnDisk
        Samples for early stopping and recalibration.
    calibration : Samples or SamplesOnDisk
        Samples that only conformal intervals are fitted to.
    train_rows, validation_rows, calibration_rows : Tensor of int
        Row numbers of the three subsets among all training samples.
    """

    train: AnySamples
    validation: AnySamples
    calibration: AnySamples
    train_rows: Tensor
    validation_rows: Tensor
    calibration_rows: Tensor


def set_aside(rows: Tensor, count: int, seed: int, purpose: int) -> tuple[Tensor, Tensor]:
    """Split off `count` random rows; return the remaining and the split-off rows, both sorted."""
    generator = torch.Generator().manual_seed(stream(seed, purpose))
    order = torch.randperm(len(rows), generator=generator)
    return rows[order[count:].sort().values], rows[order[:count].sort().values]


def split_training(samples: AnySamples, config: Model) -> TrainingSplit[AnySamples]:
    """Split the training samples by the number and the fractions of a configuration.

    Raises
    ------
    InputError
        If there are fewer samples than the configuration uses, or none are left for a subset.
    """
    training, total = config.training, config.training.samples or len(samples)
    if total > len(samples):
        raise InputError(
            f"config '{config.name}': key 'training.samples' = {total}: expected {len(samples)} at "
            "most, the number of training samples of the dataset"
        )
    rest, validation = set_aside(
        torch.arange(total),
        round(training.validation_fraction * total),
        config.seed,
        VALIDATION,
    )
    count = min(round(training.calibration_fraction * total), len(rest))
    train, calibration = set_aside(rest, count, config.seed, CALIBRATION)
    fraction = f"'training.validation_fraction' = {training.validation_fraction}"
    if len(train) == 0:
        taken = f"{fraction}, 'training.calibration_fraction' = {training.calibration_fraction}"
        raise InputError(f"config '{config.name}': key {taken} leave none of {total} samples")
    for key in training.validation_users:
        if len(validation) == 0:
            raise InputError(
                f"config '{config.name}': key {fraction} takes none of {total} samples, but "
                f"'training.{key}' expects some"
            )
    parts = [cast(AnySamples, samples.subset(r)) for r in (train, validation, calibration)]
    return TrainingSplit(parts[0], parts[1], parts[2], train, validation, calibration)
