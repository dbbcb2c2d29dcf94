"""Calibration of a run's intervals and bounds, on samples that its training has not seen.

They are held-out samples of its dataset, or random loads with their corrections as the truth.
"""

from __future__ import annotations

import logging
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError, WorkError, first_line
from shared_schema.common.machine import require_memory
from shared_schema.common.progress import Progress
from surrogate.learning.data.case_loads import (
    TRAINED,
    Loads,
    families_of,
    random_loads,
    trained_loads,
)
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run, require_changeable
from surrogate.learning.runs.split import split_training
from surrogate.mechanics import FollowingLoads
from surrogate.mechanics.certify.calibrated_range import LEAST_STIFFNESS
from surrogate.mechanics.certify.certificate_protocol import LEVEL
from surrogate.mechanics.certify.conformal import KINDS, ConformalCalibration, Intervals
from surrogate.mechanics.certify.fast_certificate import FastCertificate
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
FEWEST = 20  # corrected loads: of fewer, no bound holds with a probability of 95 %


def loads_of(surrogate: Surrogate, family: str = TRAINED) -> Loads:
    """Random dead loads of a run's training, or of another family; InputError as `drawn_loads`."""
    data = surrogate.description.data
    limit, numbers = data.info.force.max_abs, data.load_numbers
    return trained_loads(surrogate.geometry, data.case, limit, numbers, family)


def drawn_loads(
    surrogate: Surrogate, count: int, random: np.random.Generator, family: str = TRAINED
) -> Array:
    """Draw load cases.

    Body forces and patches of traction are drawn as the case has them. The pressures of a case are
    drawn from its ranges, and the forces beside them from its family of random nodes: the forces of
    its samples hold both.

    Parameters
    ----------
    surrogate : Surrogate
    count : int
        Number of load cases.
    random : Generator
    family : str
        Such as ``trained`` or ``loads=1-8,reach=2,places=free``
        (`surrogate.learning.data.case_loads`).

    Returns
    -------
    array, (count, n_nodes, d)
        Nodal forces in N, with those of pressures on the undeformed body.

    Raises
    ------
    InputError
        If the family is wrong, or a case with pressures has other loads than random nodes of a
        symmetric range beside them.
    """
    body, data = surrogate.geometry, surrogate.description.data
    if not body.surfaces:
        return loads_of(surrogate, family).draw(count, random)
    families = families_of(data.case)
    ranges = [given["range"] for given in families if given["family"] == "pressure"]
    forces = np.zeros((count, *body.coordinates.shape))
    for given in families:
        low, high = given["range"]
        if given["family"] == "random_nodes" and low == -high:
            fewest, most = given["count"]
            limits = (high,) * body.dimension
            forces += random_loads(family, body, limits, (fewest, most)).draw(count, random)
        elif given["family"] != "pressure":
            raise InputError(
                f"load family '{given['family']}', range {low} to {high}: expected random_nodes of "
                "a symmetric range, and pressure"
            )
    low, high = np.transpose(ranges)
    pressures = random.uniform(low, high, (count, len(ranges)))
    pressed = FollowingLoads.of(body, pressures)
    at_nodes = pressed.load[:, : len(body.coordinates)]
    return np.asarray(forces + np.where(body.held, 0, at_nodes))


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
        predicted = surrogate.passes_in_shapes(samples.force, samples.parameters, passes, seed)
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
        loads = Load.of_samples(surrogate.geometry, forces)
        estimate = surrogate.fast_estimate
        _, _, softest = estimate.with_stability(loads.dead, predicted.mean, loads.following)
        rows, truth = [], []
        stable = np.flatnonzero(softest > LEAST_STIFFNESS)
        with closing(Progress(len(stable), unit="loads", title="corrected")) as progress:
            for done, row in enumerate(stable, start=1):
                try:
                    found = surrogate.body.correct(loads[int(row)], predicted.mean[row])
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
            "split (surrogate calibrate does without a dataset)",
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


def require_one_shape(surrogate: Surrogate) -> None:
    """Raise InputError if fast bounds would be those of one of many shapes."""
    if surrogate.geometry.shapes is not None:
        raise InputError(
            "certify: fast bounds are those of a body of one shape; full certificates, directions "
            "and corrections are for all",
            "certify",
        )


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
    load = Load.of_samples(surrogate.geometry, samples.force)
    return FastCertificate.fit(
        surrogate.fast_estimate, load.dead, predicted.mean, samples.truth, std, load.following
    )


@checked_arguments
def calibrate(
    run: str | Path, *, loads: int = 100, fresh: int = 0, family: str = TRAINED, seed: int = 0
) -> FastCertificate:
    """Calibrate the fast bounds of a run on random loads, and write them into it.

    Each prediction is corrected to the equilibrium of the finite elements, which takes most of the
    time; loads whose predicted state is not stable are left out. What the evaluation of the run
    says of other fast bounds is replaced by what is measured on `fresh` loads.

    Parameters
    ----------
    run : str or Path
        Run folder.
    loads : int
        Number of loads, 20 at least.
    fresh : int
        Number of further loads, on which the bounds are measured.
    family : str
        Random loads (`surrogate.learning.inference.calibration`).
    seed : int
        Of the loads, 0 or more.

    Returns
    -------
    FastCertificate

    Raises
    ------
    InputError
        If the run comes with the package, a number or the family is wrong, too few loads have a
        stable prediction and a correction, or the body has no fast bounds.
    """
    require_changeable(Path(run), None)
    if loads < FEWEST:
        raise InputError(f"loads {loads}: expected {FEWEST} at least", "loads")
    for key, value in {"fresh": fresh, "seed": seed}.items():
        if value < 0:
            raise InputError(f"{key} {value}: expected 0 or more", key)
    model = load(run)
    require_one_shape(model)
    model.body.equilibrium  # noqa: B018 (refuses a run without a material, before the work)
    fields = 4 * (loads + fresh) * model.geometry.coordinates.nbytes
    require_memory(fields, f"loads {loads}: the fields", "loads")
    forces = drawn_loads(model, loads + fresh, np.random.default_rng(seed), family)
    samples = HeldOut.corrected(model, forces[:loads], PASSES, seed)
    if len(samples.force) < FEWEST:
        raise InputError(
            f"loads {loads}: {len(samples.force)} of them have a stable prediction and a "
            f"correction, expected {FEWEST} at least; more or smaller loads",
            "loads",
        )
    fast = fit_on_samples(model, samples)
    folder = RunFolder(find_run(run))
    content: dict[str, Any] | None = None
    if fresh:
        found = HeldOut.corrected(model, forces[loads:], PASSES, seed)
        content = {
            "calibration": f"{loads} random loads, family {family}, seed {seed}, "
            f"{len(samples.force)} predicted stable and corrected",
            **measured(fast, model, found, fresh),
        }
        logger.info(
            "of %d fresh loads %d have bounds of probability %g; exceeded: %d of the mean error, "
            "%d of the largest",
            *(fresh, content["bounded"]["bounded"], LEVEL),
            *content["bounded"]["exceeded"].values(),
        )
    folder.write_fast_certificate(fast.serialised(), content)
    return fast


def measured(fast: FastCertificate, model: Surrogate, fresh: HeldOut, loads: int) -> dict[str, Any]:
    """Measure the bounds on fresh samples; those of `loads` that are not among them are refused."""
    load = Load.of_samples(model.geometry, fresh.force)
    predicted, std = fresh.predicted.mean, fresh.predicted.std
    of = std if std.any() else None
    content = fast.measures(load.dead, predicted, fresh.truth, of, load.following)
    bounds = fast.certify(load.dead, predicted, LEVEL, None, load.following)
    bounded = np.isfinite(bounds.largest)
    content["refused"] = 1 - int(bounded.sum()) / loads
    error = predicted - fresh.truth
    exceeded = {
        "mean": np.abs(error).mean(axis=(1, 2)) > bounds.mean,
        "largest": np.linalg.norm(error, axis=2).max(axis=1) > bounds.largest,
    }
    content["bounded"] = {
        "level": LEVEL,
        "loads": loads,
        "bounded": int(bounded.sum()),
        "exceeded": {name: int(more.sum()) for name, more in exceeded.items()},
    }
    return content
