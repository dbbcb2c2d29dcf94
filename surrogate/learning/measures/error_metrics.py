r"""The paper's measures of error (Deshpande et al. 2022, Section "Validation Metrics").

.. math::
    e_m = \frac{1}{F} \sum_{i=1}^{F} |U(f_m)^i - u_m^i|, \qquad
    \bar e = \frac{1}{M} \sum_m e_m, \qquad
    σ(e) = \sqrt{\frac{1}{M-1} \sum_m (e_m - \bar e)^2}

with F the number of degrees of freedom (of nodes, clamped ones included; not of empty grid points).
Beside them, the errors of the stresses that follow from predicted displacements.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
AT_ONCE = 2**18  # cells of all samples that are held at once


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


@dataclass(frozen=True)
class StressMeasures:
    """Errors of von Mises stresses at the middle of the cells, over M samples.

    Attributes
    ----------
    mean_error : float
        Mean absolute error over samples and cells in Pa.
    relative_error : float
        Mean over the samples of the mean absolute error over the cells, relative to the largest
        stress of the sample.
    relative_error_of_largest_median : float
        Median over the samples of the relative error of the largest stress.
    inverted_cells : int
        Number of cells that predictions turn inside out; they are left out.
    """

    mean_error: float
    relative_error: float
    relative_error_of_largest_median: float
    inverted_cells: int

    def plain(self) -> dict[str, float | int]:
        """Return the measures as plain data."""
        return asdict(self)


def measure_stresses(
    surrogate: Surrogate,
    predicted: Array,
    reference: Array,
    dead: Array | None = None,
    following: FollowingLoads | None = None,
) -> StressMeasures | None:
    """Measure the stresses of predictions; None if the material is none of the shipped ones.

    Parameters
    ----------
    surrogate : Surrogate
    predicted, reference : array, (M, n_nodes, d)
        Displacements in m.
    dead : array, (M, n_nodes or n_points, d), optional
        Dead loads in N, under which points between the nodes move; none by default.
    following : FollowingLoads, optional
        Pressures of the samples; none by default.
    """
    try:
        surrogate.body.equilibrium  # noqa: B018
    except InputError:
        return None
    step = max(1, AT_ONCE // len(surrogate.geometry.cells))
    dead = np.zeros_like(predicted) if dead is None else dead
    parts = []
    for start in range(0, len(predicted), step):
        some = slice(start, start + step)
        of_load = partial(surrogate.body.stresses_under, Load(dead, following)[some])
        parts.append(_errors(of_load(predicted[some]), of_load(reference[some])))
    mean, largest, of_largest, inverted = map(np.concatenate, zip(*parts, strict=True))
    stressed = largest > 0
    relative = np.divide(mean, largest, out=np.zeros_like(mean), where=stressed)
    return StressMeasures(
        mean_error=float(mean.mean()),
        relative_error=float(relative.mean()),
        relative_error_of_largest_median=float(np.median(of_largest)),
        inverted_cells=int(inverted.sum()),
    )


def _errors(
    found: dict[str, Array], expected: dict[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Mean error, largest stress, relative error of the largest, inverted cells: (M,) each."""
    sound = found["jacobian"] > 0
    ours = np.where(sound, found["von_mises"], 0.0)
    theirs = np.where(sound, expected["von_mises"], 0.0)
    mean = np.abs(ours - theirs).sum(axis=1) / np.maximum(sound.sum(axis=1), 1)
    largest = theirs.max(axis=1)
    error = np.abs(ours.max(axis=1) - largest)
    of_largest = np.divide(error, largest, out=np.zeros_like(error), where=largest > 0)
    return mean, largest, of_largest, (~sound).sum(axis=1)
