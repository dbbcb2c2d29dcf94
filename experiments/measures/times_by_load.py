"""Times of solutions and of predictions under small loads and under large ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.framework.record import Cell, Claim, Table, join_named
from experiments.measures.errors_on_test_split import BODIES
from experiments.measures.solutions import Solutions

TENTH = 10  # reciprocal of the share of load cases that counts as small, and as large
GROWTH = 1.2  # smallest ratio of times that counts as growth; below, times are the same


@dataclass(frozen=True)
class Ends:
    """A number under small and under large loads."""

    small: float
    large: float

    @property
    def ratio(self) -> float:
        """Ratio of large and small."""
        return self.large / self.small


@dataclass(frozen=True)
class TimesByLoad:
    """Effort of the solutions and predictions for one body.

    Attributes
    ----------
    solving : Ends
        Time of the finite elements in ms.
    iterations : Ends
        Number of Newton iterations.
    networks : dict of str to Ends
        Time of a prediction in ms, by the likelihood of the network, D or VB.
    """

    solving: Ends
    iterations: Ends
    networks: dict[str, Ends]


def solving_ends(solutions: Solutions) -> tuple[Ends, Ends]:
    """Medians of time in ms and Newton iterations, tenths with the smallest and largest ‖F‖."""
    order = np.argsort(solutions.force)
    count = max(1, len(order) // TENTH)

    def ends(values: NDArray[np.float64] | NDArray[np.int64]) -> Ends:
        return Ends(*(float(np.median(values[s])) for s in (order[:count], order[-count:])))

    return ends(1e3 * solutions.seconds), ends(solutions.iterations)


def load_table(times: Mapping[str, TimesByLoad]) -> Table:
    """Table of the times of all cases."""
    rows: list[tuple[Cell, ...]] = []
    for case, found in times.items():
        quantities = {"t_FEM [ms]": found.solving, "Newton iterations": found.iterations}
        quantities |= {f"prediction ({kind}) [ms]": ends for kind, ends in found.networks.items()}
        rows += [(BODIES[case], p, e.small, e.large, e.ratio) for p, e in quantities.items()]
    return Table(
        caption="Finite elements: medians over the tenths of the load cases with the smallest and "
        "with the largest ‖F‖. Deterministic U-Nets (D) on a CPU and Bayesian ones (VB, all "
        "passes, weights kept): the test samples with the smallest and with the largest ‖F‖.",
        head=("example", "", "small loads", "large loads", "ratio"),
        rows=tuple(rows),
    )


def solving_grows(times: Mapping[str, TimesByLoad]) -> Claim:
    """Test whether the finite elements take longer under larger loads, in every case."""
    ratios = {BODIES[case]: found.solving.ratio for case, found in times.items()}
    return Claim(
        what="The time of the finite elements grows with the force.",
        holds=min(ratios.values()) >= GROWTH,
        evidence=f"Under large over small loads: {join_named(ratios)} (each ≥ {GROWTH:g}).",
    )


def predicting_does_not(times: Mapping[str, TimesByLoad]) -> Claim:
    """Test whether all networks take the same time under small and under large loads."""
    ratios = {
        f"{BODIES[case]} ({kind})": ends.ratio
        for case, found in times.items()
        for kind, ends in found.networks.items()
    }
    return Claim(
        what="The time of a prediction is the same whatever the force.",
        holds=all(1 / GROWTH < ratio < GROWTH for ratio in ratios.values()),
        evidence=f"Under the largest over the smallest load: {join_named(ratios)} (each within a "
        f"factor of {GROWTH:g}).",
    )
