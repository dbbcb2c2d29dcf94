"""Calibration of a run's intervals and bounds, on samples that its training has not seen."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.errors import InputError, WorkError, first_line
from shared_schema.common.progress import Progress
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.runs.split import split_training
from surrogate.mechanics.certify.calibrated_range import LEAST_STIFFNESS
from surrogate.mechanics.certify.conformal import KINDS, ConformalCalibration, Intervals
from surrogate.mechanics.certify.fast_certificate import FastCertificate
from surrogate.mechanics.statics.load import separated

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeldOut:
    """Samples that were not trained on, and their predictions.

    Attributes
    ----------
    force : array, (n, n_nodes or n_points, d)
        Loads in N, with the forces of pressures on the undeformed body.
    truth : array, (n, n_nodes, d)
        In m.
    predicted : Distribution
    """

    force: Array
    truth: Array
    predicted: Distribution

    @classmethod
    def of(
        cls, surrogate: Surrogate, dataset: Dataset, rows: Tensor, passes: int, seed: int
    ) -> HeldOut:
        """Predict some samples of the training split, by their rows in it."""
        samples = dataset.nodal_train(rows)
        predicted = surrogate.averaged_passes(samples.force, passes, seed)
        return cls(samples.load, samples.displacement, predicted)

    @classmethod
    def corrected(cls, surrogate: Surrogate, forces: Array, passes: int, seed: int) -> HeldOut:
        """Predict load cases that no dataset holds; the truth is the correction of a prediction.

        Those whose predicted state is not stable, or that have no correction, are left out.

        Parameters
        ----------
        surrogate : Surrogate
        forces : array, (N, n_nodes, d)
            In N, as `force`.
        passes, seed : int
            Of a stochastic network.

        Raises
        ------
        InputError
            If the pressures cannot be told from other forces, or the run does not name its
            material.
        """
        predicted = surrogate.averaged_passes(forces, passes, seed)
        dead, pressure = separated(surrogate.geometry, forces)
        _, _, softest = surrogate.fast_estimate.with_stability(dead, predicted.mean, pressure)
        values = np.zeros((len(forces), 0)) if pressure is None else pressure.pressures
        rows, truth = [], []
        stable = np.flatnonzero(softest > LEAST_STIFFNESS)
        with closing(Progress(len(stable), unit="loads", title="corrected")) as progress:
            for done, row in enumerate(stable, start=1):
                pushed = None if pressure is None else values[row]
                try:
                    found = surrogate.correct(forces[row], predicted.mean[row], pressure=pushed)
                except WorkError:
                    continue
                finally:
                    progress.update(done)
                rows.append(row)
                truth.append(found.displacement)
        kept = np.array(rows, dtype=np.int64)
        parts = predicted.mean, predicted.std_epistemic, predicted.std_aleatoric
        known = Distribution(*(part[kept] for part in parts))
        return cls(forces[kept], np.reshape(truth, known.mean.shape), known)


def fit_intervals(
    surrogate: Surrogate, dataset: Dataset, level: float, passes: int, seed: int
) -> Intervals:
    """Fit conformal intervals to the calibration split of a run's training samples.

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
            f"conformal {level}: not the dataset that the run was trained on, which holds its "
            "calibration split",
            "conformal",
        )
    rows = split_training(dataset.training, description.run).calibration_rows
    if len(rows) == 0:
        raise InputError(
            f"conformal {level}: the run has no calibration split, "
            f"'training.calibration_fraction' = {fraction}, expected above 0",
            "conformal",
        )
    samples = HeldOut.of(surrogate, dataset, rows, passes, seed)
    mean, std = samples.predicted.mean, surrogate.score_scale(samples.predicted)
    free = surrogate.geometry.free
    try:
        calibrations = {
            kind: ConformalCalibration.fit(level, kind, mean, std, samples.truth, free)
            for kind in KINDS
        }
    except ValueError as error:
        raise InputError(f"conformal {level}: {first_line(error)}", "conformal") from None
    return Intervals(level, len(rows), calibrations)


def fit_fast_certificate(
    surrogate: Surrogate, dataset: Dataset, passes: int, seed: int
) -> FastCertificate:
    """Calibrate the fast certificate on the held-out samples of a run.

    They are the calibration and the validation samples; the latter are left out if the training
    looked at them, to stop early.

    Raises
    ------
    InputError
        If the run has no held-out samples, does not name its material, or was trained on another
        dataset; or the pressures of its samples cannot be told from other forces.
    """
    description = surrogate.description
    if dataset.manifest.digest != description.data.digest:
        raise InputError(
            "certify: not the dataset that the run was trained on, which holds its calibration "
            "split",
            "certify",
        )
    split = split_training(dataset.training, description.run)
    rows = split.calibration_rows
    if "early_stopping" not in description.run.training.validation_users:
        rows = torch.cat([rows, split.validation_rows])
    if len(rows) == 0:
        raise InputError(
            "certify: the run has no held-out samples, 'training.calibration_fraction' = "
            f"{description.run.training.calibration_fraction}, expected above 0",
            "certify",
        )
    return fit_on_samples(surrogate, HeldOut.of(surrogate, dataset, rows, passes, seed))


def fit_on_samples(surrogate: Surrogate, samples: HeldOut) -> FastCertificate:
    """Calibrate the fast certificate on samples that were not trained on.

    Raises
    ------
    InputError
        If the pressures of the samples cannot be told from other forces, or the run does not name
        its material.
    """
    predicted = samples.predicted
    std = predicted.std if surrogate.is_probabilistic else None
    dead, pressure = separated(surrogate.geometry, samples.force)
    return FastCertificate.fit(
        surrogate.fast_estimate, dead, predicted.mean, samples.truth, std, pressure
    )
