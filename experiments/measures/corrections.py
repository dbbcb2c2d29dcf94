"""Newton's method from several starts: iterations, and processor time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.framework.timing import timed
from shared_schema.common import WorkError
from surrogate.mechanics import Equilibrium
from surrogate.mechanics.certify import Correction, correct, iterated

Array = NDArray[np.float64]
ZERO, LINEAR, PREDICTION = "undeformed body", "linear response", "safest of three"
Work = Callable[[], Correction]


@dataclass(frozen=True)
class Effort:
    """Effort of Newton's method for some load cases.

    Attributes
    ----------
    found : dict of int to Correction
        Equilibria by the number of the load case.
    iterations, seconds : array, (n,)
        Of those that are solved; processor time.
    lost : int
        Load cases for which no equilibrium was found.
    """

    found: dict[int, Correction]
    iterations: Array
    seconds: Array
    lost: int


def corrected(work: Work) -> tuple[Correction | None, float]:
    """Equilibrium that a correction finds, if it finds one, and its processor time in s."""

    def attempt() -> Correction | None:
        try:
            return work()
        except WorkError:
            return None

    return timed(attempt, time.process_time)


def efforts(ways: Callable[[int], Mapping[str, Work]], count: int) -> dict[str, Effort]:
    """Bring load cases to equilibrium in several ways, in turn for each load.

    Parameters
    ----------
    ways : callable
        Function that returns the ways by their names for the number of a load case.
    count : int
        Number of load cases.
    """
    found: dict[str, dict[int, tuple[Correction, float]]] = {name: {} for name in ways(0)}
    for number in range(count):
        for name, work in ways(number).items():
            correction, seconds = corrected(work)
            if correction is not None:
                found[name][number] = correction, seconds
    return {
        name: Effort(
            {number: correction for number, (correction, _) in of.items()},
            np.array([correction.iterations for correction, _ in of.values()], dtype=np.float64),
            np.array([seconds for _, seconds in of.values()]),
            count - len(of),
        )
        for name, of in found.items()
    }


def newton_starts(equilibrium: Equilibrium, force: Array, predicted: Array) -> dict[str, Effort]:
    """Bring load cases to equilibrium from several starts, in turn for each load.

    Parameters
    ----------
    equilibrium : Equilibrium
    force, predicted : array, (N, n_nodes, d)
        In N and m. The third start is the state of lowest energy among prediction, linear response
        and undeformed body.
    """
    return efforts(lambda k: _works(equilibrium, force[k], predicted[k]), len(force))


def _works(equilibrium: Equilibrium, f: Array, u: Array) -> dict[str, Work]:
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
