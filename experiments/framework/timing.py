"""Wall times of predictions, and of the finite elements for the same loads."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared_schema.common.configuration import Frozen
from shared_schema.dataset_reader import DatasetReader
from surrogate.inference.surrogate import Surrogate

Array = NDArray[np.float64]

WARM_UP = 3


class Timing(Frozen):
    """Limits of the repeats of one median time, whichever is reached first.

    Attributes
    ----------
    repeats : int
        Largest number of repeats.
    seconds : float
        Time after which no further repeat begins.
    """

    repeats: int = Field(200, ge=1, le=10**6)
    seconds: float = Field(5.0, gt=0, le=10**6)


TIMING = Timing()


def median_seconds(work: Callable[[], object], timing: Timing = TIMING) -> float:
    """Median wall time of repeated work after a warm-up."""
    return alternating_seconds([work], timing)[0]


def alternating_seconds(
    works: Sequence[Callable[[], object]], timing: Timing = TIMING
) -> list[float]:
    """Median wall times of several works in turn, so that other load slows all of them alike."""
    for _ in range(WARM_UP):
        for work in works:
            work()
    times: list[list[float]] = [[] for _ in works]
    while len(times[0]) < timing.repeats and sum(times[0]) < timing.seconds:
        for work, taken in zip(works, times, strict=True):
            began = time.perf_counter()
            work()
            taken.append(time.perf_counter() - began)
    return [float(np.median(taken)) for taken in times]


def prediction_seconds(
    surrogate: Surrogate,
    force: Array,
    passes: int = 1,
    timing: Timing = TIMING,
    drawn_anew: bool = False,
) -> float:
    """Median time of predicting one load in s, NumPy arrays in and out.

    Parameters
    ----------
    surrogate : Surrogate
    force : array, (n_nodes, d)
        Nodal forces in N.
    passes : int
        Number of passes T.
    timing : Timing
    drawn_anew : bool
        Draw the weights of the passes for every prediction. Otherwise the weights of the
        prediction before are kept as far as they fit into memory.
    """
    predict = prediction(surrogate, force, passes)

    def predict_anew() -> None:
        surrogate.passes.forget()
        predict()

    return median_seconds(predict_anew if drawn_anew else predict, timing)


def prediction(surrogate: Surrogate, force: Array, passes: int) -> Callable[[], object]:
    """Make a function that predicts one load, (n_nodes, d) in N, by the fastest way."""
    if surrogate.is_probabilistic:
        return partial(surrogate.predict_distribution, force, passes)
    return partial(surrogate.predict, force)


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
