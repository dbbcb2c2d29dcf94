"""Times of work: of one call, and medians over repeated calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from pydantic import Field

from shared_schema.common import Frozen

Value = TypeVar("Value")
WARM_UP = 3  # calls before the first that is timed, at most as many as are timed


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


def timed(
    work: Callable[[], Value], clock: Callable[[], float] | None = None
) -> tuple[Value, float]:
    """Result of a call, and the time in s that it took: wall time, or that of another clock."""
    clock = clock or time.perf_counter
    began = clock()
    result = work()
    return result, clock() - began


def median_seconds(work: Callable[[], object], timing: Timing = TIMING) -> float:
    """Median wall time of repeated work after a warm-up of at most as many calls."""
    return alternating_seconds([work], timing)[0]


def alternating_seconds(
    works: Sequence[Callable[[], object]], timing: Timing = TIMING
) -> list[float]:
    """Median wall times of several works in turn, so that other load slows all of them alike."""
    for _ in range(min(WARM_UP, timing.repeats)):
        for work in works:
            work()
    times: list[list[float]] = [[] for _ in works]
    while len(times[0]) < timing.repeats and sum(times[0]) < timing.seconds:
        for work, taken in zip(works, times, strict=True):
            taken.append(timed(work)[1])
    return [float(np.median(taken)) for taken in times]
