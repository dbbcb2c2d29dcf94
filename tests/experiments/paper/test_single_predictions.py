from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import spearmanr

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.measures.error_displacement_correlation import (
    error_correlation,
    split_correlations,
)
from experiments.paper.single_predictions import EXAMPLES


def test_examples_are_loaded_where_and_moved_as_far_as_the_papers(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    """Loads on bodies of 3.5 m: at the end, in the last quarter, between 1/4 and 3/4."""
    result = result_of("single-predictions")
    (table,) = result.tables
    ends = {"beam": (3.5, 3.5), "lshape": (3.5, 3.5), "beam3d-end": (2.625, 3.5)}
    ends["beam3d-middle"] = (0.875, 2.625)
    for name, row, comparison in zip(EXAMPLES, table.rows, result.comparisons, strict=True):
        dataset, lower_upper = resources.dataset_of(EXAMPLES[name].run), ends[name]
        test, x = dataset.nodal_test, dataset.geometry.coordinates[:, 0]
        tip = dataset.geometry.tip
        moved = np.linalg.norm(test.displacement[:, tip], axis=1)
        loaded = x[test.force.any(axis=2).argmax(axis=1)]
        there = (loaded >= lower_upper[0]) & (loaded <= lower_upper[1])
        assert there.any()
        aim = EXAMPLES[name].paper.tip_displacement_m
        number = min(np.flatnonzero(there), key=lambda m: abs(moved[m] - aim))
        error = (
            resources.predicted_test(EXAMPLES[name].run).mean[number] - test.displacement[number]
        )
        newtons = np.linalg.norm(test.force[number])
        assert row[2:6] == pytest.approx((newtons, moved[number], aim, 1e3 * np.abs(error).mean()))
        free = dataset.geometry.coordinates[:, 0] > 0
        norms = [np.linalg.norm(u, axis=1)[free] for u in (error, test.displacement[number])]
        assert row[6] == pytest.approx(spearmanr(*norms).statistic)
        assert comparison.ours == pytest.approx(100 * np.linalg.norm(error[tip]) / moved[number])


def test_the_papers_numbers(result_of: Callable[[str], Findings]) -> None:
    """Section "Prediction accuracy" of the paper: relative tip errors in %, displacements in m."""
    result = result_of("single-predictions")
    assert [c.paper for c in result.comparisons] == pytest.approx([0.6, 0.4, 0.6, 1.6])
    assert [row[4] for row in result.tables[0].rows] == [0.95, 2.39, 1.1, 0.26]
    close = {"beam3d-end-close", "beam3d-middle-close"}
    assert result.figures.keys() == EXAMPLES.keys() | close


def test_error_that_follows_the_displacement() -> None:
    """Ranks of nodes that move by 1, 2, 3 m: errors in the same order, in the opposite one, 2 3 1.

    The last by Spearman's formula 1 − 6 Σd² / (n (n² − 1)) with d = 1, 1, −2.
    """
    reference = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [3.0, 0.0]])
    errors = np.array([[9.0, 0.1, 0.2, 0.3], [9.0, 0.3, 0.2, 0.1], [9.0, 0.2, 0.3, 0.1]])
    predicted = reference + np.stack([errors, 0 * errors], axis=-1)
    free = np.array([False, True, True, True])
    reference = np.broadcast_to(reference, predicted.shape)
    found = error_correlation(predicted, reference, free)
    assert found == pytest.approx([1, -1, -0.5])


def test_pattern_of_the_whole_test_split(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    """Twelve samples a body, each by SciPy; the claim is on all three bodies."""
    for run in ("beam2d-det", "beam3d-det"):
        test, found = resources.dataset_of(run).nodal_test, split_correlations(resources, run)
        free = resources.dataset_of(run).geometry.coordinates[:, 0] > 0
        for m, predicted in enumerate(resources.predicted_test(run).mean):
            error = np.linalg.norm(predicted - test.displacement[m], axis=1)[free]
            moved = np.linalg.norm(test.displacement[m], axis=1)[free]
            assert found[m] == pytest.approx(spearmanr(error, moved).statistic)
        assert found.shape == (12,)
    (claim,) = result_of("single-predictions").claims
    assert all(f"({body}, " in claim.evidence for body in ("2D beam", "2D L-shape", "3D beam"))
