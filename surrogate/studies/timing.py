"""How long predictions take, and how long the finite elements took for the same loads."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.dataset_reader import DatasetReader
from surrogate.inference.prediction import Surrogate

Array = NDArray[np.float64]

WARM_UP = 3
REPEATS = 200
SECONDS = 5.0  # at most, for one median


def median_seconds(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median wall time of some work after a warm-up, over as many repeats as there is time for."""
    return alternating_seconds([work], repeats)[0]


def alternating_seconds(
    works: Sequence[Callable[[], object]], repeats: int = REPEATS
) -> list[float]:
    """Median wall times of works in turn, so that what else the machine does slows all of them."""
    for _ in range(WARM_UP):
        for work in works:
            work()
    times: list[list[float]] = [[] for _ in works]
    while len(times[0]) < repeats and sum(times[0]) < SECONDS:
        for work, taken in zip(works, times, strict=True):
            began = time.perf_counter()
            work()
            taken.append(time.perf_counter() - began)
    return [float(np.median(taken)) for taken in times]


def prediction_seconds(
    surrogate: Surrogate, force: Array, passes: int = 1, drawn_anew: bool = False
) -> float:
    """Median time of predicting one load in s, NumPy arrays in and out.

    Parameters
    ----------
    surrogate : Surrogate
    force : array, (n_nodes, d)
        In N.
    passes : int
        T.
    drawn_anew : bool
        Whether every prediction draws the passes' weights, which else stay drawn from the one
        before as far as there is memory for them.
    """

    def predict() -> None:
        if drawn_anew:
            surrogate.passes.forget()
        surrogate.predict_distribution(force, passes)

    return median_seconds(predict)


@dataclass(frozen=True)
class Solutions:
    """What the finite elements needed for every load case of a dataset.

    Attributes
    ----------
    force : array, (M,)
        ‖F‖₂ of all nodal forces in N.
    seconds : array, (M,)
        Wall time on what made the dataset.
    iterations : array of int, (M,)
        Of Newton's method, in all load steps.
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
