"""Errors of the stresses that follow from predicted displacements."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.equilibrium.follower_pressure import FollowerPressure
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
AT_ONCE = 2**18  # cells of all samples that are held at once


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
    pressure: FollowerPressure | None = None,
) -> StressMeasures | None:
    """Measure the stresses of predictions; None if the material is none of the shipped ones.

    Parameters
    ----------
    surrogate : Surrogate
    predicted, reference : array, (M, n_nodes, d)
        Displacements in m.
    dead : array, (M, n_nodes or n_points, d), optional
        Dead loads in N, under which points between the nodes move; none by default.
    pressure : FollowerPressure, optional
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
        of_load = partial(surrogate.body.stresses_under, Load(dead, pressure)[some])
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
