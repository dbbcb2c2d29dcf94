from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.training_times import (
    RUNS,
    Duration,
    bayes_is_longer,
    space_is_longer,
)


def test_rows(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """N = 48, of which 2 % are for validation and 2 % for calibration, by the fast recipes.

    Epochs and minutes are those of the last line of ``metrics.jsonl``.
    """
    result = result_of("training-times")
    for run, row in zip(RUNS, result.tables[0].rows[::2], strict=True):
        last = json.loads(resources.run(run).metrics.read_text().splitlines()[-1])
        weights = [p.numel() for p in resources.surrogate(run).network.parameters()]
        expected = (48, 4, 2, last["seconds"] / 60, sum(weights) / 1e6)
        assert row[2:7] == pytest.approx(expected)


def test_beside_the_paper(result_of: Callable[[str], Findings]) -> None:
    """Table "Tab: training_times", Section "sec:training_UNets": N, epochs, min, 10⁶ parameters."""
    result = result_of("training-times")
    assert [row[2:3] + row[4:7] for row in result.tables[0].rows[1::2]] == [
        (5700, 600, 131, 7.5),
        (5700, 600, 226, 15.1),
        (3800, 600, 78, 7.5),
        (3800, 600, 143, 14.6),
        (33688, 75, 1060, 94.1),
    ]
    assert [comparison.paper for comparison in result.comparisons] == [131, 226, 78, 143, 1060]


PAPER = {
    "beam2d-det": Duration(600, 131.0),
    "beam2d-vb": Duration(600, 226.0),
    "lshape2d-det": Duration(600, 78.0),
    "lshape2d-vb": Duration(600, 143.0),
    "beam3d-det": Duration(75, 1060.0),
}


def test_claims_hold_of_the_papers_numbers_and_not_of_others() -> None:
    """Epochs are compared: half of 143 minutes for half of the epochs is the same."""
    claim = bayes_is_longer("lshape2d", PAPER)
    assert claim.holds
    assert claim.evidence.startswith("14.3 s an epoch (143 min) and 7.8 s an epoch (78 min); ")
    assert bayes_is_longer("lshape2d", PAPER | {"lshape2d-vb": Duration(300, 71.5)}).holds
    assert not bayes_is_longer("lshape2d", PAPER | {"lshape2d-vb": Duration(600, 77.0)}).holds
    assert not bayes_is_longer("lshape2d", PAPER | {"lshape2d-vb": Duration(1200, 143.0)}).holds
    assert space_is_longer(PAPER).holds
    assert not space_is_longer(PAPER | {"beam3d-det": Duration(75, 130.0)}).holds
