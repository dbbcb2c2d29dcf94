"""Conformal intervals of a run, fitted to its calibration split and saved in its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from shared_schema.common.errors import InputError, first_line
from surrogate.certify.conformal import ConformalCalibration, Kind
from surrogate.data.dataset import Dataset
from surrogate.inference.prediction import Distribution, Surrogate
from surrogate.runs.split import split_training
from surrogate.runs.tensor_file import load_tensors, serialised

KINDS: tuple[Kind, ...] = ("marginal", "simultaneous")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Intervals:
    """Conformal intervals of one level, of both kinds.

    Attributes
    ----------
    level : float
        Nominal coverage 1 − α.
    samples : int
        Number of calibration samples.
    calibrations : dict
        Fitted factors by kind.
    """

    level: float
    samples: int
    calibrations: dict[Kind, ConformalCalibration]

    def bounds(
        self, kind: Kind, surrogate: Surrogate, predicted: Distribution
    ) -> tuple[Array, Array]:
        """Return the lower and upper ends of the intervals of a prediction, in m, of its shape."""
        return self.calibrations[kind].interval(predicted.mean, score_scale(surrogate, predicted))

    def measures(
        self, surrogate: Surrogate, predicted: Distribution, reference: Array
    ) -> dict[str, Any]:
        """Measure the coverage on other samples, (M, n_nodes, d), and the mean width in m.

        Coverage is the share of the free components for marginal intervals, and the share of whole
        samples for simultaneous ones. The result is plain data.
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

    def serialised(self) -> bytes:
        """Content of a file of the intervals, which `load_intervals` reads."""
        tensors: dict[str, Tensor] = {
            kind: torch.from_numpy(calibration.factor)
            for kind, calibration in self.calibrations.items()
        }
        return serialised(tensors, {"level": repr(self.level), "samples": str(self.samples)})


def score_scale(surrogate: Surrogate, predicted: Distribution) -> ArrayLike:
    """Divisor of the errors in the scores: σ in m, or 1 m for a surrogate that predicts no σ."""
    return predicted.std if surrogate.is_probabilistic else 1.0


def fit_intervals(
    surrogate: Surrogate, dataset: Dataset, level: float, passes: int, seed: int
) -> Intervals:
    """Fit intervals to the calibration split of a run's training samples.

    Raises
    ------
    InputError
        If the run has no calibration split, the split is too small for the level, the level is not
        between 0 and 1, or the run was trained on another dataset.
    """
    description = surrogate.description
    fraction = description.run.training.calibration_fraction
    if dataset.manifest.digest != description.data.digest:
        raise InputError(
            f"--conformal {level}: not the dataset that the run was trained on, which holds its "
            "calibration split"
        )
    rows = split_training(dataset.training, description.run).calibration_rows
    if len(rows) == 0:
        raise InputError(
            f"--conformal {level}: the run has no calibration split, "
            f"'training.calibration_fraction' = {fraction}, expected above 0"
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
                score_scale(surrogate, predicted),
                samples.displacement,
                free,
            )
            for kind in KINDS
        }
    except ValueError as error:
        raise InputError(f"--conformal {level}: {first_line(error)}") from None
    return Intervals(level, len(rows), calibrations)


def load_intervals(path: Path) -> Intervals:
    """Read a file of `Intervals.serialised`.

    Raises
    ------
    InputError
        If the file is missing or damaged.
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
