"""Certificates against true errors: estimates, corrections by them, and fast certificates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from experiments.framework.timing import TIMING, Timing, median_seconds
from surrogate import Surrogate
from surrogate.learning.measures import sample_errors
from surrogate.mechanics.certify import Certificate, FastCertificate, certify, correct

Array = NDArray[np.float64]
WITHIN = (0.8, 1.5)  # estimated over true errors that are close to 1
PERCENTILES = (0, 5, 50, 95, 100)
SETTLED = 1e-11  # N; datasets are solved to 1e-8 N, and errors of some networks are as small


@dataclass(frozen=True)
class Certified:
    """Predictions with their certificates.

    Attributes
    ----------
    surrogate : Surrogate
    force, truth, predicted : array, (N, n_nodes, d)
        In N and m; solutions to a residual of `SETTLED`.
    certificate : Certificate
    errors : tuple of 3 arrays, (N,)
        Mean errors in m of the predictions, and after one and two corrections.
    """

    surrogate: Surrogate
    force: Array
    truth: Array
    predicted: Array
    certificate: Certificate
    errors: tuple[Array, Array, Array]

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.force.shape[2])

    @property
    def effectivity(self) -> Array:
        """Estimated over true mean errors, (N,)."""
        return np.asarray(self.certificate.mean_error / self.errors[0])

    def measures(self) -> dict[str, Any]:
        """Compare estimated and true errors, and errors before and after corrections; in m."""
        before, once, twice = self.errors
        return {
            "mean_error": float(before.mean()),
            "settled": float(self.certificate.settled.mean()),
            "effectivity_percentiles": {
                str(level): percentile(self.effectivity, level) for level in PERCENTILES
            },
            "within_0.8_and_1.5": within(self.effectivity),
            "spearman": float(spearmanr(before, self.certificate.mean_error)[0]),
            "median_error_before": float(np.median(before)),
            "median_error_without_estimate": float(np.median(once)),
            "median_error_after_two": float(np.median(twice)),
            "raised": int((once > before).sum()),
        }


def certified(surrogate: Surrogate, force: Array, truth: Array, predicted: Array) -> Certified:
    """Certify predictions, and correct them twice.

    Parameters
    ----------
    surrogate : Surrogate
    force, truth, predicted : array, (N, n_nodes, d)
        Loads in N; solutions of a dataset and predictions in m.
    """
    body = surrogate.body.equilibrium
    settled = np.stack(
        [correct(body, f, u, SETTLED).displacement for f, u in zip(force, truth, strict=True)]
    )
    certificate = certify(body, force, predicted)
    once = predicted - finite(certificate.error)
    twice = once - finite(certify(body, force, once).error)
    before = sample_errors(predicted, settled)
    after = sample_errors(once, settled)
    last = sample_errors(twice, settled)
    return Certified(surrogate, force, settled, predicted, certificate, (before, after, last))


def finite(error: Array) -> Array:
    """Estimated errors in m, none where there is no estimate."""
    return np.where(np.isfinite(error), error, 0.0)


def within(ratio: Array) -> float:
    """Share of effectivities close to 1."""
    return float(((ratio >= WITHIN[0]) & (ratio <= WITHIN[1])).mean())


def percentile(ratio: Array, level: float) -> float:
    """Percentile of effectivities; the estimate of a prediction that inverts cells is infinite."""
    return float(np.percentile(ratio, level, method="inverted_cdf"))


def fast_measures(
    fast: FastCertificate, one: Certified, reference: Array, timing: Timing = TIMING
) -> dict[str, Any]:
    """Coverage and width of fast bounds, their rank correlation with errors, and time in ms.

    Parameters
    ----------
    fast : FastCertificate
    one : Certified
    reference : array, (N, n_nodes, d)
        Solutions in m that the bounds are for.
    timing : Timing
        Repeats of the time of one load.
    """
    force, predicted = one.force, one.predicted
    estimated = np.abs(fast.estimate(force, predicted)).mean(axis=(1, 2))
    seconds = median_seconds(lambda: fast.estimate(force[:1], predicted[:1]), timing)
    return {
        "test_split": fast.measures(force, predicted, reference),
        "spearman": float(spearmanr(one.errors[0], estimated)[0]),
        "median_milliseconds": 1e3 * seconds,
    }
