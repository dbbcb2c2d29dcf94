"""Places where several nodes stand, and a body is split."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shared_schema.common.bodies.nodal_forces import COINCIDENT


def split_warning(coordinates: NDArray[np.float64]) -> str | None:
    """Say where parts of a body touch and share no nodes, (n_nodes, d) in m; None if nowhere.

    Programs that mesh each part for itself leave the nodes between them twice, where a body would
    be torn; a crack is meant so.
    """
    distance = COINCIDENT * float(np.ptp(coordinates, axis=0).max())
    pairs = cKDTree(coordinates).query_pairs(distance, output_type="ndarray")
    if not len(pairs):
        return None
    at = ",".join(f"{value:g}" for value in coordinates[pairs.min()])
    return (
        f"{len(np.unique(pairs))} nodes share their places with others, the first at {at}: the "
        "body is split there, expected parts that share their nodes if it is no crack"
    )
