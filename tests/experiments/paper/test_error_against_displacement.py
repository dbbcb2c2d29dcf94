from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.error_against_displacement import (
    BAYESIAN,
    DETERMINISTIC,
    sensitivity_claim,
)


def test_slopes(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Cov(x, e) / Var(x), of e_m = mean absolute error and x = ‖u‖ at the loaded node."""
    result = result_of("error-against-displacement")
    for run, row in zip((*DETERMINISTIC, *BAYESIAN), result.tables[0].rows, strict=True):
        test = resources.dataset_of(run).nodal_test
        nodes = test.force.any(axis=2).argmax(axis=1)
        x = np.linalg.norm(test.displacement[np.arange(12), nodes], axis=1)
        error = resources.predicted_test(run).mean - test.displacement
        e = np.abs(error).mean(axis=(1, 2))
        slope = np.cov(x, e)[0, 1] / x.var(ddof=1)
        larger = x > np.median(x)
        ratio = e[larger].mean() / e[~larger].mean()
        assert row[1:] == pytest.approx((1e3 * slope, 1e3 * (e.mean() - slope * x.mean()), ratio))


def test_the_papers_slopes(result_of: Callable[[str], Findings]) -> None:
    """Figures "det_sensitivity" and "average_errors_bayesian" of the paper, in 10⁻³."""
    comparisons = result_of("error-against-displacement").comparisons
    assert [c.paper for c in comparisons] == pytest.approx([0.8, 0.5, 1, 5, 6])
    assert all(c.ours >= 0 for c in comparisons)


def test_sensitivity_claim() -> None:
    """The limit is 9 mm in a metre, rising or falling: 1.5 times 6 mm of the L-shape by VB."""
    assert sensitivity_claim({"a": 0.001, "b": -0.0089}).holds
    claim = sensitivity_claim({"a": 0.001, "b": -0.0091})
    assert not claim.holds
    assert "of b, rises by -9.1 mm in a metre (≤ 9 mm, 1.5 times " in claim.evidence
