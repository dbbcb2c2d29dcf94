"""The one sample of a case that is shown as meshes and fields."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SHARE = 0.75  # of the largest tip displacement, where none is asked for


def find_example(
    force: Array,
    displacement: Array,
    tip: int,
    nodes: NDArray[np.int64] | NDArray[np.bool_],
    aim: float | None = None,
) -> int:
    """Find the sample whose tip is displaced most nearly as far as is asked for.

    Parameters
    ----------
    force, displacement : array, (M, n_nodes, d)
        In N and m.
    tip : int
        Node whose displacement counts.
    nodes : array of int or of bool, (n_nodes,)
        One of them is loaded; if none of them ever is, any sample may be found.
    aim : float, optional
        Tip displacement in m; otherwise `SHARE` of the largest there is.
    """
    moved = np.linalg.norm(displacement[:, tip], axis=1)
    candidates = np.flatnonzero(force[:, nodes].any(axis=(1, 2)))
    if candidates.size == 0:
        candidates = np.arange(len(moved))
    if aim is None:
        aim = SHARE * float(moved[candidates].max())
    return int(candidates[np.abs(moved[candidates] - aim).argmin()])


def tip_measures(predicted: Array, reference: Array, tip: int) -> tuple[float, float]:
    """Tip displacement ‖u‖ in m of one sample, (n_nodes, d) twice, and ‖U − u‖ / ‖u‖ there."""
    moved = float(np.linalg.norm(reference[tip]))
    error = float(np.linalg.norm(predicted[tip] - reference[tip]))
    return moved, error / moved if moved else 0.0
