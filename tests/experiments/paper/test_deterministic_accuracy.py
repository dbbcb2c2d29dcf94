from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.deterministic_accuracy import RUNS


def test_errors_are_those_of_the_predictions(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    """ē = mean over samples of the mean absolute error of all components (paper, Eq. 27)."""
    result = result_of("deterministic-accuracy")
    (table,) = result.tables
    for run, row in zip(RUNS, table.rows, strict=True):
        test = resources.dataset_of(run).nodal_test
        errors = np.abs(resources.predicted_test(run).mean - test.displacement).mean(axis=(1, 2))
        assert row[1:] == pytest.approx((12, 1e3 * errors.mean(), 1e3 * errors.std(ddof=1)))


def test_numbers_stand_beside_the_papers(result_of: Callable[[str], Findings]) -> None:
    """Table "det_metrics" of the paper, in mm."""
    papers = [comparison.paper for comparison in result_of("deterministic-accuracy").comparisons]
    assert papers == pytest.approx([0.3, 0.2, 0.8, 0.4, 0.6, 0.3])
