from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.training_ranges import more_uncertain
from tests.surrogate.force_sweeps import hand_made


def test_more_uncertain_at_nearly_every_force_outside() -> None:
    """σ twice as large outside; then smaller at one of the four forces there."""
    larger = hand_made()
    twice = 2 * larger.std_epistemic
    claim = more_uncertain(larger, hand_made(std_epistemic=twice))
    assert claim.holds
    assert "100 %" in claim.evidence
    assert "2.0 times" in claim.evidence
    smaller = hand_made(std_epistemic=np.where(larger.force == 3, 0.001, twice))
    assert not more_uncertain(larger, smaller).holds


def test_ratios(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Ratio of both networks' σ at the forces nearest to ±8 N, the ends of the made-up sweep."""
    result = result_of("training-ranges")
    larger, smaller = (
        resources.predicted_loads(run, "beam2d_sweep") for run in ("beam2d-vb", "beam2d_f1-vb")
    )
    expected = [
        1e3 * loads.predicted.std[[0, -1], loads.node, 1].mean() for loads in (larger, smaller)
    ]
    force, wide, narrow, ratio = result.tables[0].rows[-1]
    assert (force, wide, narrow) == pytest.approx((8, *expected))
    assert ratio == pytest.approx(expected[1] / expected[0])
