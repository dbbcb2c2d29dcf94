"""Conformal intervals of a run: fitted to its calibration part, and kept in its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.errors import InputError, first_line
from surrogate.data.dataset import Dataset
from surrogate.inference.prediction import Distribution, Surrogate
from surrogate.runs.split import split_training
from surrogate.runs.tensor_file import load_tensors, save_atomically
from surrogate.uncertainty.conformal import ConformalCalibration, Kind

KINDS: tuple[Kind, ...] = ("marginal", "simultaneous")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Intervals:
    """Intervals of one level, of every kind.

    Attributes
    ----------
    level : float
        1 − α.
    samples : int
        Number of calibration samples.
    calibrations : dict
        By kind.
    """

    level: float
    samples: int
    calibrations: dict[Kind, ConformalCalibration]

    def bounds(
        self, kind: Kind, surrogate: Surrogate, predicted: Distribution
    ) -> tuple[Array, Array]:
        """Lower and upper end of the intervals about a prediction, in m, of its shape."""
        return self.calibrations[kind].interval(predicted.mean, spread(surrogate, predicted))

    def measures(
        self, surrogate: Surrogate, predicted: Distribution, reference: Array
    ) -> dict[str, Any]:
        """Coverage on other samples, (M, n_nodes, d), and mean width in m, as plain data.

        Marginal intervals cover components of free nodes, simultaneous ones whole samples.
        """
        free = ~surrogate.geometry.clamped
        content: dict[str, Any] = {"level": self.level, "samples": self.samples}
        for kind in KINDS:
            lower, upper = self.bounds(kind, surrogate, predicted)
            inside = ((lower <= reference) & (reference <= upper))[:, free]
            covered = inside if kind == "marginal" else inside.all(axis=(1, 2))
            content[kind] = {
                "coverage": float(covered.mean()),
                "width": float((upper - lower)[:, free].mean()),
            }
        return content

    def save(self, path: Path) -> None:
        """Write atomically."""
        tensors: dict[str, Tensor] = {
            kind: torch.from_numpy(calibration.factor)
            for kind, calibration in self.calibrations.items()
        }
        save_atomically(tensors, path, {"level": repr(self.level), "samples": str(self.samples)})


def spread(surrogate: Surrogate, predicted: Distribution) -> ArrayLike:
    """What errors are measured in: σ in m, or 1 m of a surrogate that predicts none."""
    return predicted.std if surrogate.is_probabilistic else 1.0


def fit_intervals(
    surrogate: Surrogate, dataset: Dataset, level: float, passes: int, seed: int
) -> Intervals:
    """Fit intervals to the calibration part of a run's training split.

    Raises
    ------
    InputError
        If the run kept no such part, it is too small for the level, the level is not between 0
        and 1, or the dataset is not the one that the run was trained on.
    """
    description = surrogate.description
    fraction = description.run.training.calibration_fraction
    if dataset.manifest.digest != description.data.digest:
        raise InputError(
            f"--conformal {level}: not the dataset that the run was trained on, whose training "
            "split has its calibration part"
        )
    rows = split_training(dataset.train, description.run).calibration_rows
    if len(rows) == 0:
        raise InputError(
            f"--conformal {level}: the run kept no samples for it, 'training.calibration_fraction' "
            f"= {fraction}, expected above 0"
        )
    samples = dataset.nodal_train(rows)
    predicted = surrogate.predict_distribution(samples.force, passes, seed)
    free = ~surrogate.geometry.clamped
    try:
        calibrations = {
            kind: ConformalCalibration.fit(
                level,
                kind,
                predicted.mean,
                spread(surrogate, predicted),
                samples.displacement,
                free,
            )
            for kind in KINDS
        }
    except ValueError as error:
        raise InputError(f"--conformal {level}: {first_line(error)}") from None
    return Intervals(level, len(rows), calibrations)


def load_intervals(path: Path) -> Intervals:
    """Read what `Intervals.save` wrote.

    Raises
    ------
    InputError
        If there is nothing, or it is damaged.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no conformal intervals in the run, expected them from 'surrogate evaluate "
            "RUN --data DIR --conformal LEVEL'"
        )
    tensors, metadata = load_tensors(path)
    try:
        level, samples = float(metadata["level"]), int(metadata["samples"])
        calibrations = {
            kind: ConformalCalibration(level, kind, tensors[kind].numpy()) for kind in KINDS
        }
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not conformal intervals ({first_line(error)})") from None
    return Intervals(level, samples, calibrations)
