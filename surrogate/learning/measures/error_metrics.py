r"""The paper's measures of error (Deshpande et al. 2022, Section "Validation Metrics").

.. math::
    e_m = \frac{1}{F} \sum_{i=1}^{F} |U(f_m)^i - u_m^i|, \qquad
    \bar e = \frac{1}{M} \sum_m e_m, \qquad
    σ(e) = \sqrt{\frac{1}{M-1} \sum_m (e_m - \bar e)^2}

with F the number of degrees of freedom (of nodes, clamped ones included; not of empty grid points).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorMeasures:
    """Errors of predictions on M samples.

    Attributes
    ----------
    samples : int
        Number of samples M.
    mean_error : float
        Mean error ē in m.
    std_error : float
        Standard deviation σ(e) of the errors in m.
    max_error : float
        Largest absolute error of any component of any sample, in m.
    relative_tip_error_median, relative_tip_error_mean : float
        Median and mean over the samples of the relative error ‖U − u‖ / ‖u‖ at the tip node.
    relative_error_mean : float
        Mean over the samples of e_m, relative to the largest displacement of a node of the sample.
    relative_node_error_median : float
        Median over the samples of the largest error of a node, relative to the same.
    slope, intercept : float
        Slope and intercept of the least-squares line of e_m over the displacement magnitude at the
        loaded node.
    """

    samples: int
    mean_error: float
    std_error: float
    max_error: float
    relative_tip_error_median: float
    relative_tip_error_mean: float
    relative_error_mean: float
    relative_node_error_median: float
    slope: float
    intercept: float

    def plain(self) -> dict[str, float | int]:
        """Return the measures as plain data."""
        return asdict(self)


def sample_errors(predicted: Array, reference: Array) -> Array:
    """Mean error e_m of every sample: (M, n_nodes, d) and (M, n_nodes, d) in m → (M,) in m."""
    return np.abs(predicted - reference).mean(axis=(1, 2))


def node_errors(predicted: Array, reference: Array) -> Array:
    """Error ‖U − u‖₂ at every node: (..., n_nodes, d) in m → (..., n_nodes) in m."""
    return np.linalg.norm(predicted - reference, axis=-1)


def displacement_at_load(force: Array, displacement: Array) -> Array:
    """Largest ‖u‖ at a loaded node of every sample: (M, n_nodes, d) twice → (M,) in m."""
    loaded = np.any(force != 0.0, axis=2)
    magnitude = np.linalg.norm(displacement, axis=2)
    return np.where(loaded, magnitude, 0.0).max(axis=1)


def regression_line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and intercept of the least-squares line of y over x; slope 0 where x is constant."""
    if len(x) < 2 or float(np.ptp(x)) == 0.0:
        return 0.0, float(np.mean(y))
    slope, intercept = np.polyfit(x, y, 1)
    return float(slope), float(intercept)


def measure(force: Array, predicted: Array, reference: Array, tip: int) -> ErrorMeasures:
    """Measure predictions against reference solutions.

    Parameters
    ----------
    force, predicted, reference : array, (M, n_nodes, d)
        Forces in N, displacements in m.
    tip : int
        Node of the relative error.
    """
    errors = sample_errors(predicted, reference)
    magnitude = np.linalg.norm(reference[:, tip], axis=1)
    moved = magnitude > 0
    tip_errors = node_errors(predicted, reference)[moved, tip] / magnitude[moved]
    largest = np.linalg.norm(reference, axis=2).max(axis=1)
    scale = np.where(largest > 0, largest, np.inf)
    worst = node_errors(predicted, reference).max(axis=1)
    slope, intercept = regression_line(displacement_at_load(force, reference), errors)
    return ErrorMeasures(
        samples=len(errors),
        mean_error=float(errors.mean()),
        std_error=float(errors.std(ddof=1)) if len(errors) > 1 else 0.0,
        max_error=float(np.abs(predicted - reference).max()),
        relative_tip_error_median=float(np.median(tip_errors)),
        relative_tip_error_mean=float(tip_errors.mean()),
        relative_error_mean=float((errors / scale).mean()),
        relative_node_error_median=float(np.median(worst / scale)),
        slope=slope,
        intercept=intercept,
    )
