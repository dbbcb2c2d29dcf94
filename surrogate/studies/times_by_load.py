"""Times of solutions and of predictions under small loads and under large ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.studies.accuracy import BODIES
from surrogate.studies.record import Cell, Claim, Table, listed
from surrogate.studies.timing import Solutions

TENTH = 10  # of the load cases
GROWTH = 1.2  # times as long under large loads from which on a time grows, below it is the same


@dataclass(frozen=True)
class Ends:
    """A number under small and under large loads."""

    small: float
    large: float

    @property
    def ratio(self) -> float:
        """Large over small."""
        return self.large / self.small


@dataclass(frozen=True)
class TimesByLoad:
    """What one body's solutions and predictions need.

    Attributes
    ----------
    solving : Ends
        Finite elements, in ms.
    iterations : Ends
        Of Newton's method.
    networks : dict of str to Ends
        Predictions in ms, by the networks' likelihood, D or VB.
    """

    solving: Ends
    iterations: Ends
    networks: dict[str, Ends]


def solving_ends(solutions: Solutions) -> tuple[Ends, Ends]:
    """Time in ms and Newton iterations: medians of the tenths with the smallest, largest ‖F‖."""
    order = np.argsort(solutions.force)
    count = max(1, len(order) // TENTH)

    def ends(values: NDArray[np.float64] | NDArray[np.int64]) -> Ends:
        return Ends(*(float(np.median(values[s])) for s in (order[:count], order[-count:])))

    return ends(1e3 * solutions.seconds), ends(solutions.iterations)


def load_table(times: Mapping[str, TimesByLoad]) -> Table:
    """Times of all cases."""
    rows: list[tuple[Cell, ...]] = []
    for case, found in times.items():
        parts = {"t_FEM [ms]": found.solving, "Newton iterations": found.iterations}
        parts |= {f"prediction ({kind}) [ms]": ends for kind, ends in found.networks.items()}
        rows += [(BODIES[case], p, e.small, e.large, e.ratio) for p, e in parts.items()]
    return Table(
        caption="Finite elements: medians over the tenths of the load cases with the smallest and "
        "with the largest ‖F‖. Deterministic U-Nets (D) on a CPU and Bayesian ones (VB, all "
        "passes, weights kept): the test samples with the smallest and with the largest ‖F‖.",
        head=("example", "", "small loads", "large loads", "ratio"),
        rows=tuple(rows),
    )


def solving_grows(times: Mapping[str, TimesByLoad]) -> Claim:
    """Whether the finite elements take longer under larger loads, of every case."""
    ratios = {BODIES[case]: found.solving.ratio for case, found in times.items()}
    return Claim(
        what="The time of the finite elements grows with the force.",
        holds=min(ratios.values()) >= GROWTH,
        evidence=f"Under large over small loads: {listed(ratios)} (each ≥ {GROWTH:g}).",
    )


def predicting_does_not(times: Mapping[str, TimesByLoad]) -> Claim:
    """Whether all networks take the same time under small and under large loads."""
    ratios = {
        f"{BODIES[case]} ({kind})": ends.ratio
        for case, found in times.items()
        for kind, ends in found.networks.items()
    }
    return Claim(
        what="The time of a prediction is the same whatever the force.",
        holds=all(1 / GROWTH < ratio < GROWTH for ratio in ratios.values()),
        evidence=f"Under the largest over the smallest load: {listed(ratios)} (each within a "
        f"factor of {GROWTH:g}).",
    )
