"""Rank correlation of nodal error and nodal displacement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.framework.resources import Resources
from surrogate.learning.measures import node_errors
from surrogate.learning.probabilistic import rank_correlation

Array = NDArray[np.float64]


def error_correlation(predicted: Array, reference: Array, free: NDArray[np.bool_]) -> Array:
    """Rank correlation of nodal error and nodal displacement over the free nodes.

    Parameters
    ----------
    predicted, reference : array, (..., n_nodes, d)
        Displacements in m.
    free : array of bool, (n_nodes,)

    Returns
    -------
    array, (...)
        1 if the error grows with the displacement from node to node.
    """
    error, moved = node_errors(predicted, reference), np.linalg.norm(reference, axis=-1)
    return rank_correlation(error[..., free], moved[..., free])


def split_correlations(resources: Resources, run: str) -> Array:
    """Rank correlation of nodal error and displacement in each test sample, (M,)."""
    dataset, predicted = resources.dataset_of(run), resources.predicted_test(run).mean
    reference = dataset.nodal_test.displacement
    return error_correlation(predicted, reference, ~dataset.geometry.clamped)
