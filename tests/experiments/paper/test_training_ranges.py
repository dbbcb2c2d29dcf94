from __future__ import annotations

from collections.abc import Callable

import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources


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
