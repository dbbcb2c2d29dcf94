from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.bayesian_accuracy import BAYESIAN, RUNS


def errors(resources: Resources, run: str) -> np.ndarray:
    """e_m of the test split in mm."""
    test = resources.dataset_of(run).nodal_test
    mean = resources.predicted_test(run).mean
    result: np.ndarray = 1e3 * np.abs(mean - test.displacement).mean(axis=(1, 2))
    return result


def test_errors_and_coverage(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Shares of |u − μ| ≤ Φ⁻¹((1 + p) / 2) σ over the nodes that are not clamped."""
    accuracy, coverage = result_of("bayesian-accuracy").tables
    for run, row in zip(RUNS, accuracy.rows, strict=True):
        e = errors(resources, run)
        assert row[1:] == pytest.approx((12, e.mean(), e.std(ddof=1)))
    for run, row in zip(BAYESIAN, coverage.rows, strict=True):
        predicted, dataset = resources.predicted_test(run), resources.dataset_of(run)
        free = dataset.geometry.coordinates[:, 0] > 0
        std = np.hypot(predicted.std_epistemic, predicted.std_aleatoric)[:, free]
        z = np.abs(predicted.mean - dataset.nodal_test.displacement)[:, free] / std
        shares = [100 * np.mean(z <= norm.ppf((1 + p) / 2)) for p in (0.5, 0.9, 0.95)]
        assert row[1:] == pytest.approx((*shares, 1e3 * std.mean()))


def test_beside_the_paper(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """Table "bayesian_table" of the paper, in mm; a claim for each body, of a failure."""
    result = result_of("bayesian-accuracy")
    assert [c.paper for c in result.comparisons] == pytest.approx([1.3, 1.3, 5.3, 3.7])
    for case, claim in zip(("beam2d", "lshape2d"), result.claims, strict=True):
        worse = errors(resources, f"{case}-vb").mean() > errors(resources, f"{case}-det").mean()
        assert claim.verdict == ("reproduced" if worse else "better")
