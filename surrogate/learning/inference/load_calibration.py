"""Calibration of fast bounds on random loads, without a dataset: the truth is the correction."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory
from surrogate.learning.data.load_families import TRAINED
from surrogate.learning.inference.calibrated_bounds import HeldOut, fit_on_samples
from surrogate.learning.inference.fresh_loads import drawn_loads
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.probabilistic.stochastic_passes import PASSES
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.shelf import find_run, require_changeable
from surrogate.mechanics.certify.certificate_protocol import LEVEL
from surrogate.mechanics.certify.fast_certificate import FastCertificate
from surrogate.mechanics.statics.load import separated

logger = logging.getLogger(__name__)
FEWEST = 20  # corrected loads: of fewer, no bound holds with a probability of 95 %


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
        Random loads (`surrogate.learning.inference.fresh_loads`).
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
    dead, pressure = separated(model.geometry, fresh.force)
    predicted, std = fresh.predicted.mean, fresh.predicted.std
    content = fast.measures(dead, predicted, fresh.truth, std if std.any() else None, pressure)
    bounds = fast.certify(dead, predicted, LEVEL, None, pressure)
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
