"""Effort of the finite elements for the load cases of a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema import DatasetReader

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Solutions:
    """Effort of the finite elements for every load case of a dataset.

    Attributes
    ----------
    force : array, (M,)
        ‖F‖₂ of all nodal forces in N.
    seconds : array, (M,)
        Wall time on the machine that made the dataset.
    iterations : array of int, (M,)
        Newton iterations of all load steps.
    """

    force: Array
    seconds: Array
    iterations: NDArray[np.int64]


def read_solutions(nodal: Path) -> Solutions:
    """Read what a nodal dataset says of its solutions.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    names = ("samples/force", "samples/wall_time", "samples/newton_iterations")
    arrays = DatasetReader(nodal, "nodal").joined(names)
    force, seconds, iterations = (arrays[name] for name in names)
    return Solutions(np.linalg.norm(force, axis=(1, 2)), seconds, iterations)


def typical_seconds(nodal: Path) -> float:
    """Median wall time of a solution in s, on the machine that made the dataset."""
    return float(np.median(read_solutions(nodal).seconds))
