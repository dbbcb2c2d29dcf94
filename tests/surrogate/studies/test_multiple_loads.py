from __future__ import annotations

import numpy as np
import pytest

from surrogate.studies.multiple_loads import accuracy_claim, conduct, pattern_claim
from surrogate.studies.workshop import Workshop


def test_errors_under_one_and_under_several_loads(workshop: Workshop) -> None:
    """All from the definitions; the example is the one whose tip moves most nearly by 0.55 m."""
    outcome = conduct(workshop)
    tip = workshop.dataset_of("beam2d-det").geometry.tip
    loads = workshop.predicted_loads("beam2d-det", "beam2d_multiple")
    test = workshop.dataset_of("beam2d-det").nodal_test
    pairs = (
        (workshop.predicted_test("beam2d-det").mean, test.displacement),
        (loads.predicted.mean, loads.samples.displacement),
    )
    for row, (predicted, reference) in zip(outcome.tables[0].rows, pairs, strict=True):
        error, moved = predicted - reference, np.linalg.norm(reference[:, tip], axis=1)
        relative = np.linalg.norm(error[:, tip], axis=1) / moved
        assert row[1] == len(reference)
        assert row[2] == pytest.approx(1e3 * np.abs(error).mean())
        assert row[4] == pytest.approx(100 * np.median(relative))
    number = np.abs(moved - 0.55).argmin()
    (comparison,) = outcome.comparisons
    assert (comparison.ours, comparison.paper) == pytest.approx((100 * relative[number], 0.6))


def test_claims() -> None:
    assert accuracy_claim(0.049).holds
    assert not accuracy_claim(0.051).holds
    assert pattern_claim(single=0.8, several=0.5).holds
    assert not pattern_claim(single=0.8, several=0.75).holds
