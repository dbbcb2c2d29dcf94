"""The parts of the training split: to train on, to watch, and to calibrate intervals with."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from surrogate.data.dataset import Samples
from surrogate.runs.configuration import RunConfig
from surrogate.seeds import CALIBRATION, VALIDATION, stream


@dataclass(frozen=True)
class Parts:
    """Disjoint random parts of the training split, each in its order.

    Attributes
    ----------
    train, validation, calibration : Samples
        What the weights are fitted to; what says when to stop, and how wide the bands are; and
        what nothing but conformal intervals ever sees.
    calibration_rows : Tensor of int
        Which samples of the training split the last ones are.
    """

    train: Samples
    validation: Samples
    calibration: Samples
    calibration_rows: Tensor


def set_aside(rows: Tensor, count: int, seed: int, purpose: int) -> tuple[Tensor, Tensor]:
    """Set `count` random rows aside: those left, and those, each in its order."""
    generator = torch.Generator().manual_seed(stream(seed, purpose))
    order = torch.randperm(len(rows), generator=generator)
    return rows[order[count:].sort().values], rows[order[:count].sort().values]


def split_parts(samples: Samples, config: RunConfig) -> Parts:
    """Split the training split as a configuration says.

    Raises
    ------
    InputError
        If no samples are left for one of the parts that the configuration uses.
    """
    training, total = config.training, len(samples)
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
    for key, is_given in (
        ("early_stopping", training.early_stopping is not None),
        ("recalibrate", training.recalibrate),
    ):
        if is_given and len(validation) == 0:
            raise InputError(
                f"config '{config.name}': key {fraction} takes none of {total} samples, but "
                f"'training.{key}' expects some"
            )
    return Parts(samples[train], samples[validation], samples[calibration], calibration)
