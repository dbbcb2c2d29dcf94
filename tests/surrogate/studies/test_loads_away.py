from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from surrogate.extrapolation import Extrapolation
from surrogate.studies.errors_by_distance import ErrorsByDistance
from surrogate.studies.loads_away import conduct, drop_claim, growth_claim, uncertainty_claim
from surrogate.studies.workshop import Workshop


def three_nodes() -> Extrapolation:
    """Nodes at y = 1, 0.6 and 0 m, the first loaded in the training; loads on the last first.

    The prediction errs by 1 m and 2 m at the loaded node, by 0.1 m at the next one after it.
    """
    nodes = np.array([2, 0, 1])
    force, reference = np.zeros((3, 3, 2)), np.zeros((3, 3, 2))
    force[np.arange(3), nodes, 1] = 1.5
    mean, std = reference.copy(), np.full((3, 3, 2), 0.3)
    mean[np.arange(3), nodes] = 1.0, 2.0
    mean[np.arange(3), (nodes + 1) % 3, 0] = 0.1
    std[0, 2] = 3, 4
    geometry = SimpleNamespace(
        coordinates=np.array([[4.0, 1.0], [4.0, 0.6], [4.0, 0.0]]),
        loadable=np.array([True, False, False]),
    )
    content: dict[str, Any] = {
        "surrogate": SimpleNamespace(geometry=geometry),
        "samples": SimpleNamespace(force=force, displacement=reference),
        "predicted": SimpleNamespace(mean=mean, std=std),
    }
    return cast(Extrapolation, SimpleNamespace(**content))


def test_errors_by_distance() -> None:
    """Six components: e = (1 + 2 + 0.1) / 6; ‖(1, 2)‖ = √5; ‖(3, 4)‖ = 5 at the last node."""
    found = ErrorsByDistance(three_nodes())
    assert found.order.tolist() == [1, 2, 0]
    assert found.distance == pytest.approx([0, 0.4, 1])
    assert found.mean_error == pytest.approx([3.1 / 6] * 3)
    assert found.max_error == pytest.approx([2] * 3)
    assert found.error == pytest.approx([5**0.5] * 3)
    assert found.std == pytest.approx([0.3 * 2**0.5, 0.3 * 2**0.5, 5])


def test_rows_are_the_errors_of_both_networks(workshop: Workshop) -> None:
    """The made-up loads are all at one node of the training line: order and distance stay."""
    outcome = conduct(workshop)
    rows = np.array(outcome.tables[0].rows, dtype=float)
    assert rows[:, 0].tolist() == list(range(1, 61))
    assert (rows[:, 1] == 0).all()
    for run, column in (("beam2d-det", 2), ("beam2d-vb", 4)):
        loads = workshop.predicted_loads(run, "beam2d_away")
        error = np.abs(loads.predicted.mean - loads.samples.displacement)
        assert rows[:, column] == pytest.approx(1e3 * error.mean(axis=(1, 2)))
        assert rows[:, column + 1] == pytest.approx(1e3 * error.max(axis=(1, 2)))
    assert outcome.figures.keys() == {"errors", "second", "farthest"}


def test_growth_and_drop() -> None:
    """By up to two orders of magnitude: 32 to 316 times, in either error."""
    rising, other = np.array([1.0, 2.0, 20.0, 33.0]), np.array([1.0, 3.0, 2.0, 31.0])
    assert growth_claim(rising).holds
    assert not growth_claim(other).holds
    assert drop_claim(rising, other).holds
    assert drop_claim(other, rising).holds
    assert drop_claim(other, other).verdict == "better"
    assert drop_claim(10 * rising - 9, rising).verdict == "differs"


def test_uncertainty_is_unreliable_where_the_error_is_beyond_its_95_percent() -> None:
    error, small, large = np.array([1.0, 20.0]), np.array([1.0, 10.0]), np.array([1.0, 11.0])
    assert uncertainty_claim(error, small).holds
    assert uncertainty_claim(error, large).verdict == "better"
    assert "σ grows 11 times, the error 20 times" in uncertainty_claim(error, large).evidence
