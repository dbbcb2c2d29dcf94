"""Sample that is shown as meshes and fields: search, and measures at the tip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SHARE = 0.75  # default aim, as a share of the largest tip displacement


def find_example(
    force: Array,
    displacement: Array,
    tip: int,
    nodes: NDArray[np.int64] | NDArray[np.bool_],
    aim: float | None = None,
) -> int:
    """Find the sample with the tip displacement nearest to an aim.

    Parameters
    ----------
    force, displacement : array, (M, n_nodes, d)
        Nodal forces in N and displacements in m.
    tip : int
        Node of the tip.
    nodes : array of int or of bool, (n_nodes,)
        Candidates are samples that load one of these nodes; all samples if there is none.
    aim : float, optional
        Tip displacement in m; by default `SHARE` of the largest among the candidates.
    """
    moved = np.linalg.norm(displacement[:, tip], axis=1)
    candidates = np.flatnonzero(force[:, nodes].any(axis=(1, 2)))
    if candidates.size == 0:
        candidates = np.arange(len(moved))
    if aim is None:
        aim = SHARE * float(moved[candidates].max())
    return int(candidates[np.abs(moved[candidates] - aim).argmin()])


def tip_measures(predicted: Array, reference: Array, tip: int) -> tuple[float, float]:
    """Tip displacement ‖u‖ in m of one sample (n_nodes, d), and ‖U − u‖ / ‖u‖ at the tip."""
    moved = float(np.linalg.norm(reference[tip]))
    error = float(np.linalg.norm(predicted[tip] - reference[tip]))
    return moved, error / moved if moved else 0.0
