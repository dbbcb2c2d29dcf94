from __future__ import annotations

import json

import pytest

from surrogate.studies.training_times import RUNS, bayes_is_longer, conduct, space_is_longer
from surrogate.studies.workshop import Workshop


def test_rows(workshop: Workshop) -> None:
    """N = 48; minutes are those of the last line of ``metrics.jsonl``."""
    outcome = conduct(workshop)
    for run, row in zip(RUNS, outcome.tables[0].rows[::2], strict=True):
        last = json.loads(workshop.run(run).metrics.read_text().splitlines()[-1])
        weights = [p.numel() for p in workshop.surrogate(run).network.parameters()]
        assert row[2:5] == pytest.approx((48, last["seconds"] / 60, sum(weights) / 1e6))


def test_beside_the_paper(workshop: Workshop) -> None:
    """Table "Tab: training_times": minutes and millions of parameters."""
    papers = [comparison.paper for comparison in conduct(workshop).comparisons]
    expected = [131, 7.5, 226, 15.1, 78, 7.5, 143, 14.6, 1060, 94.1]
    assert papers == pytest.approx(expected)


PAPER = {
    "beam2d-det": 131.0,
    "beam2d-vb": 226.0,
    "lshape2d-det": 78.0,
    "lshape2d-vb": 143.0,
    "beam3d-det": 1060.0,
}


def test_claims_hold_of_the_papers_numbers_and_not_of_others() -> None:
    assert bayes_is_longer("lshape2d", PAPER).holds
    assert not bayes_is_longer("lshape2d", PAPER | {"lshape2d-vb": 70.0}).holds
    assert space_is_longer(PAPER).holds
    assert not space_is_longer(PAPER | {"beam3d-det": 130.0}).holds
