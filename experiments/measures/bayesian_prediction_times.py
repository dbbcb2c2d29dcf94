"""Time of a Bayesian prediction: all stochastic passes of one load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from experiments.framework.record import Cell, Comparison, Table, compare
from experiments.measures.errors_on_test_split import BODIES
from experiments.paper.published_numbers import PAPER

PAPER_DEVICE = "not said; its GPU is a V100"


@dataclass(frozen=True)
class PassTimes:
    """Times of all passes of one network, in ms.

    Attributes
    ----------
    passes : int
        Number of passes; for an ensemble, of all members.
    kept : float
        Time with weights kept from the prediction before.
    anew : float
        Time with weights drawn for every prediction.
    """

    passes: int
    kept: float
    anew: float

    def by_weights(self) -> dict[str, float]:
        """Both times; keys: "kept" and "drawn anew"."""
        return {"kept": self.kept, "drawn anew": self.anew}


def pass_table(times: Mapping[str, PassTimes], passes: int, device: str) -> Table:
    """Table of the times by case, beside the paper's.

    Parameters
    ----------
    times : mapping of str to PassTimes
        Times by case.
    passes : int
        Number of passes of one network.
    device : str
        Description of the device.
    """
    rows: list[tuple[Cell, ...]] = []
    for case, found in times.items():
        rows += [
            (BODIES[case], f"weights {how}", found.passes, ms, ms / found.passes, device)
            for how, ms in found.by_weights().items()
        ]
    paper = PAPER.bayesian_prediction
    one_pass = paper.all_passes_ms / paper.passes
    rows.append(("both", "paper", paper.passes, paper.all_passes_ms, one_pass, PAPER_DEVICE))
    return Table(
        caption=f"Time of one Bayesian prediction, {passes} passes of every U-Net of an ensemble: "
        "with the passes' weights kept from the prediction before, as they are when one predicts "
        "load after load and they fit into memory; and with weights drawn for every prediction.",
        head=("example", "", "passes", "all passes [ms]", "one pass [ms]", "on"),
        rows=tuple(rows),
    )


def pass_comparisons(times: Mapping[str, PassTimes]) -> list[Comparison]:
    """Comparisons of both times of every case with the paper's."""
    paper = PAPER.bayesian_prediction.all_passes_ms
    return [
        compare(f"{BODIES[case]}: Bayesian prediction, weights {how}", "ms", ms, paper)
        for case, found in times.items()
        for how, ms in found.by_weights().items()
    ]
