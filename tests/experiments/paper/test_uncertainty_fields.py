from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.uncertainty_fields import (
    correlated,
    measure_fields,
)

# Three nodes in the plane, in m: errors of 5, 10 and 15 mm, σ of 5, 10 and 30 mm in norm.
REFERENCE = np.array([[0.0, 0.2], [0.1, 0.0], [0.0, 0.3]])
MEAN = REFERENCE + np.array([[3.0, 4.0], [6.0, 8.0], [0.0, 15.0]]) * 1e-3
STD = np.array([[4.0, 3.0], [6.0, 8.0], [30.0, 0.0]]) * 1e-3


def test_measures() -> None:
    """Ranks agree; Pearson's of (5, 10, 15) and (5, 10, 30): 125 / √(50 · 350) = 0.9449.

    Displacements of (0.2, 0.1, 0.3) m have a rank correlation of 0.5 with the errors. σ = 0 with an
    error of 15 mm is the one component of six outside the band.
    """
    measures = measure_fields(MEAN, STD, REFERENCE)
    assert measures.error == pytest.approx(10e-3)
    assert measures.std == pytest.approx(15e-3)
    assert measures.rank_correlation == pytest.approx(1.0)
    assert measures.linear_correlation == pytest.approx(125 / np.sqrt(50 * 350))
    assert measures.with_displacement == pytest.approx(0.5)
    assert measures.covered == pytest.approx(5 / 6)


def test_correlated() -> None:
    """Spearman's correlation of the ranks (1, 2, 3) and (2, 1, 3) is 0.5."""
    assert correlated("it", measure_fields(MEAN, STD, REFERENCE)).holds
    claim = correlated("it", measure_fields(MEAN, STD[[1, 0, 2]], REFERENCE))
    assert not claim.holds
    assert "nodes 0.50" in claim.evidence
    assert "with the displacement alone, rank correlation 0.50" in claim.evidence


def test_examples(resources: Resources, result_of: Callable[[str], Findings]) -> None:
    """The test sample loaded at the corner whose tip is nearest to 0.95 m, and forces of ±5 N."""
    result = result_of("uncertainty-fields")
    free = np.arange(32) >= 4  # all but the four clamped nodes
    test = resources.dataset_of("beam2d-vb").nodal_test
    predicted = resources.predicted_test("beam2d-vb")
    tip = resources.surrogate("beam2d-vb").geometry.tip
    moved = np.linalg.norm(test.displacement[:, tip], axis=1)
    at_tip = np.flatnonzero(test.force[:, tip].any(axis=1))
    number = at_tip[np.abs(moved[at_tip] - 0.95).argmin()]
    errors = np.linalg.norm(predicted.mean - test.displacement, axis=2)
    first, _, above, below = result.tables[0].rows
    assert first[1] == pytest.approx(1e3 * errors[number, free].mean())
    loads = resources.predicted_loads("beam2d-vb", "beam2d_sweep")
    vertical = loads.samples.force[:, loads.node, 1]
    for row, force in ((above, 5), (below, -5)):
        number = np.abs(vertical - force).argmin()
        error = (loads.predicted.mean - loads.samples.displacement)[number, free]
        assert row[1] == pytest.approx(1e3 * np.linalg.norm(error, axis=1).mean())
        std = np.linalg.norm(loads.predicted.std[number, free], axis=1).mean()
        assert row[2] == pytest.approx(1e3 * std)
    assert result.claims[3].holds == (0.5 <= float(first[3] or 0) <= 2)
    assert list(result.figures) == ["corner", "multiple", "beyond"]
    for row, (figure, caption) in zip(result.tables[0].rows, result.figures.values(), strict=False):
        assert f"the mean error is {row[3]:.2g} times the mean σ" in caption
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["finite elements"]
