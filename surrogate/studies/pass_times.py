"""Time of a Bayesian prediction, all stochastic passes of one load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from surrogate.evaluation.paper import PAPER
from surrogate.inference.prediction import PASSES
from surrogate.studies.accuracy import BODIES
from surrogate.studies.record import Cell, Comparison, Table, compare

PAPER_DEVICE = "not said; its GPU is a V100"


@dataclass(frozen=True)
class PassTimes:
    """Of one network, all its passes, in ms.

    Attributes
    ----------
    passes : int
        Of an ensemble those of all members.
    kept : float
        With weights that stay drawn from one prediction to the next.
    anew : float
        With weights drawn for every prediction.
    """

    passes: int
    kept: float
    anew: float

    def by_weights(self) -> dict[str, float]:
        """Both times by what is done with the weights."""
        return {"kept": self.kept, "drawn anew": self.anew}


def pass_table(times: Mapping[str, PassTimes], device: str) -> Table:
    """Times by case, beside the paper's, on a device in words."""
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
        caption=f"Time of one Bayesian prediction, {PASSES} passes of every U-Net of an ensemble: "
        "with the passes' weights kept from the prediction before, as they are when one predicts "
        "load after load and they fit into memory; and with weights drawn for every prediction.",
        head=("example", "", "passes", "all passes [ms]", "one pass [ms]", "on"),
        rows=tuple(rows),
    )


def pass_comparisons(times: Mapping[str, PassTimes]) -> list[Comparison]:
    """Both times of every case beside the paper's."""
    paper = PAPER.bayesian_prediction.all_passes_ms
    return [
        compare(f"{BODIES[case]}: Bayesian prediction, weights {how}", "ms", ms, paper)
        for case, found in times.items()
        for how, ms in found.by_weights().items()
    ]
