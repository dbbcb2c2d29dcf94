from __future__ import annotations

import json
from collections.abc import Callable

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.loss_curves import (
    convergence_claim,
    overfitting_claim,
)


def test_losses_are_those_of_the_runs(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    result = result_of("loss-curves")
    (table,) = result.tables
    for run, row in zip(("beam2d-det", "lshape2d-det"), table.rows, strict=True):
        text = (resources.trained(run).folder / "metrics.jsonl").read_text()
        lines = [json.loads(line) for line in text.splitlines()]
        validation = [line["validation_loss"] for line in lines]
        assert row[1:3] == (len(lines), lines[-1]["train_loss"])
        assert row[3:] == (validation[-1], min(validation))
    assert len(result.claims) == 2
    ((figure, _),) = result.figures.values()
    assert len(figure.axes) == 2


def test_convergence_claim() -> None:
    """The limit is a fall by a tenth in every run; here 1 to 0.91, and to 0.89."""
    assert convergence_claim({"a": [1.0] * 9 + [1.2], "b": [1.0] * 9 + [0.91]}).holds
    claim = convergence_claim({"a": [1.0] * 9 + [1.2], "b": [1.0] * 9 + [0.89]})
    assert claim.verdict == "differs"
    assert "1.2 of a, 0.89 of b (≥ 0.9)" in claim.evidence


def test_overfitting_claim() -> None:
    """The limit is a tenth above the smallest loss, in every run; training losses end at 4."""
    training = {"a": [9.0, 4.0], "b": [9.0, 4.0]}
    claim = overfitting_claim(training, {"a": [3.0, 2.0], "b": [1.0, 1.09]})
    assert claim.holds
    assert "0.50 of a, 0.27 of b" in claim.evidence
    assert not overfitting_claim(training, {"a": [3.0, 2.0], "b": [1.0, 1.11]}).holds
