"""Newton's method from several starts: iterations, and time on a CPU."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import WorkError
from surrogate.certify.correction import Correction, correct, iterated
from surrogate.mechanics.out_of_balance import Equilibrium

Array = NDArray[np.float64]
ZERO, LINEAR, PREDICTION = "undeformed body", "linear response", "safest of three"


@dataclass(frozen=True)
class Effort:
    """Effort of Newton's method for some load cases.

    Attributes
    ----------
    iterations, seconds : array, (n,)
        Of those that are solved.
    lost : int
        Load cases for which no equilibrium was found.
    """

    iterations: Array
    seconds: Array
    lost: int


def newton_starts(equilibrium: Equilibrium, force: Array, predicted: Array) -> dict[str, Effort]:
    """Bring load cases to equilibrium from several starts, in turn for each load.

    Parameters
    ----------
    equilibrium : Equilibrium
    force, predicted : array, (N, n_nodes, d)
        In N and m. The third start is the state of lowest energy among prediction, linear response
        and undeformed body.
    """
    done: dict[str, list[tuple[float, float]]] = {name: [] for name in (ZERO, LINEAR, PREDICTION)}
    for f, u in zip(force, predicted, strict=True):
        for name, work in _works(equilibrium, f, u).items():
            began = time.process_time()
            try:
                iterations = work().iterations
            except WorkError:
                continue
            done[name].append((iterations, time.process_time() - began))
    efforts = {}
    for name, found in done.items():
        columns = np.array(found, dtype=np.float64).reshape(-1, 2).T
        efforts[name] = Effort(columns[0], columns[1], len(force) - len(found))
    return efforts


def _works(equilibrium: Equilibrium, f: Array, u: Array) -> dict[str, Callable[[], Correction]]:
    def from_linear() -> Correction:
        start = equilibrium.linear_response(f[None])
        while equilibrium.inverted(start).any():
            start = start / 2
        return iterated(equilibrium, f[None], start, LINEAR)

    return {
        ZERO: lambda: iterated(equilibrium, f[None], np.zeros_like(f)[None], ZERO),
        LINEAR: from_linear,
        PREDICTION: lambda: correct(equilibrium, f, u),
    }
