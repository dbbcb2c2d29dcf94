"""How long predictions take, and how long the finite elements took for the same loads."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shared_schema.manifest import read_manifest
from shared_schema.shard import read_shard
from surrogate.prediction import Surrogate

Array = NDArray[np.float64]

WARM_UP = 3
REPEATS = 200
SECONDS = 5.0  # at most, for one median


def median_seconds(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median wall time of some work after a warm-up, over as many repeats as there is time for."""
    for _ in range(WARM_UP):
        work()
    times: list[float] = []
    while len(times) < repeats and sum(times) < SECONDS:
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def prediction_seconds(surrogate: Surrogate, force: Array, passes: int = 1) -> float:
    """Median time of predicting one load in s, NumPy arrays in and out.

    Drawn weights stay drawn from one prediction to the next, as far as there is memory for them.

    Parameters
    ----------
    surrogate : Surrogate
    force : array, (n_nodes, d)
        In N.
    passes : int
        T.
    """
    return median_seconds(lambda: surrogate.predict_distribution(force, passes))


def solving_seconds(nodal: Path) -> Array:
    """Time that every load case of a nodal dataset took on the machine that made it, (M,) in s.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    shards = read_manifest(nodal, "nodal").shards
    times: Array = np.concatenate(
        [read_shard(nodal / shard.file, "nodal")["samples/wall_time"] for shard in shards]
    )
    return times
