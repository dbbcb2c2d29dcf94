from __future__ import annotations

import json

from surrogate.studies.loss_curves import conduct, last_and_smallest, overfitting_claim
from surrogate.studies.workshop import Workshop


def test_losses_are_those_of_the_runs(workshop: Workshop) -> None:
    outcome = conduct(workshop)
    for run, row in zip(("beam2d-det", "lshape2d-det"), outcome.tables[0].rows, strict=True):
        text = (workshop.trained(run).folder / "metrics.jsonl").read_text()
        lines = [json.loads(line) for line in text.splitlines()]
        validation = [line["validation_loss"] for line in lines]
        assert row[1:3] == (len(lines), lines[-1]["train_loss"])
        assert row[3:] == (validation[-1], min(validation))
    assert len(outcome.claims) == 1
    assert outcome.figures.keys() == {"beam2d", "lshape2d"}


def test_without_validation_part() -> None:
    assert last_and_smallest([]) == (None, None)
    assert last_and_smallest([3.0, 1.0, 2.0]) == (2.0, 1.0)


def test_overfitting_claim() -> None:
    """A tenth above the smallest at most, of every run."""
    assert overfitting_claim({"a": 1.0, "b": 1.09}).holds
    assert not overfitting_claim({"a": 1.0, "b": 1.11}).holds
