from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.multiple_loads import (
    accuracy_claim,
    load_norms,
    pattern_claim,
    superposition,
)


def test_errors_under_one_and_under_several_loads(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    """Errors by their definitions; the example has the tip displacement nearest to 0.55 m.

    Every made-up sample has one load, of which the superposition is the prediction itself.
    """
    result = result_of("multiple-loads")
    tip = resources.dataset_of("beam2d-det").geometry.tip
    loads = resources.predicted_loads("beam2d-det", "beam2d_multiple")
    test = resources.dataset_of("beam2d-det").nodal_test
    several = (loads.predicted.mean, loads.samples.displacement)
    pairs = ((resources.predicted_test("beam2d-det").mean, test.displacement), several, several)
    for row, (predicted, reference) in zip(result.tables[0].rows, pairs, strict=True):
        error, moved = predicted - reference, np.linalg.norm(reference[:, tip], axis=1)
        relative = np.linalg.norm(error[:, tip], axis=1) / moved
        assert row[1] == len(reference)
        assert row[2] == pytest.approx(1e3 * np.abs(error).mean())
        assert row[4] == pytest.approx(100 * np.median(relative))
    assert "±2.5 N. Several: forces on 1 to 1 of the 7 loadable" in result.tables[0].caption
    number = np.abs(moved - 0.55).argmin()
    (comparison,) = result.comparisons
    assert (comparison.ours, comparison.paper) == pytest.approx((100 * relative[number], 0.6))


def test_superposition_adds_up_single_predictions(resources: Resources) -> None:
    """Two and three loads of two samples, each predicted by itself."""
    surrogate = resources.surrogate("beam2d-det")
    nodes = np.flatnonzero(surrogate.geometry.loadable)
    force = np.zeros((2, len(surrogate.geometry.coordinates), 2))
    expected = np.zeros_like(force)
    for sample, node in ((0, 1), (0, 4), (1, 0), (1, 2), (1, 6)):
        single = np.zeros_like(force[0])
        single[nodes[node]] = (0.3, -0.1 * node)
        force[sample] += single
        expected[sample] += surrogate.predict(single)
    found = superposition(surrogate, force)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)
    assert np.abs(found - surrogate.predict(force)).max() > 1e-4


def test_sizes_go_along_the_body() -> None:
    """3-4-5 at x = 2 m before 1 N at x = 4 m, whatever the nodes' numbers."""
    force = np.array([[0.0, -1.0], [0.0, 0.0], [3.0, 4.0]])
    assert load_norms(force, np.array([[4.0, 0.0], [3.0, 0.0], [2.0, 0.0]])).tolist() == [5, 1]


def test_claims() -> None:
    claim = accuracy_claim(np.array([0.001, 0.005, 0.049, 0.3, 0.3]))
    assert claim.holds
    assert "2 of 5 samples are below the 0.6 %" in claim.evidence
    assert not accuracy_claim(np.array([0.001, 0.051, 0.3])).holds
    assert pattern_claim(single=0.8, several=0.5).holds
    assert not pattern_claim(single=0.8, several=0.75).holds
