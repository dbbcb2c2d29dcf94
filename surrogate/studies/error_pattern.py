"""Where on the body errors are large."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.metrics import node_errors
from surrogate.studies.workshop import Workshop
from surrogate.uncertainty.calibration import rank_correlation

Array = NDArray[np.float64]


def error_follows_displacement(
    predicted: Array, reference: Array, free: NDArray[np.bool_]
) -> Array:
    """Rank correlation of nodal error and nodal displacement over the free nodes.

    Parameters
    ----------
    predicted, reference : array, (..., n_nodes, d)
        In m.
    free : array of bool, (n_nodes,)

    Returns
    -------
    array, (...)
        1 where the error is the larger the farther a node moves.
    """
    error, moved = node_errors(predicted, reference), np.linalg.norm(reference, axis=-1)
    return rank_correlation(error[..., free], moved[..., free])


def all_follow(workshop: Workshop, run: str) -> Array:
    """Rank correlation of nodal error and displacement in every test sample, (M,)."""
    dataset, predicted = workshop.dataset_of(run), workshop.predicted_test(run).mean
    reference = dataset.nodal_test.displacement
    return error_follows_displacement(predicted, reference, ~dataset.geometry.clamped)
