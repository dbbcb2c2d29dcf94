from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.paper.loads_away import (
    ErrorsByLoadDistance,
)
from surrogate.learning.measures.extrapolation import Extrapolation


def three_nodes() -> Extrapolation:
    """Nodes at y = 1, 0.6 and 0 m, the first loaded in the training; loads on the last first.

    The prediction has errors of 1 m and 2 m at the loaded node, by 0.1 m at the next one after it.
    """
    nodes = np.array([2, 0, 1])
    force, reference = np.zeros((3, 3, 2)), np.zeros((3, 3, 2))
    force[np.arange(3), nodes, 1] = 1.5
    reference[:, :, 1] = np.array([[0.3], [0.1], [0.2]])
    mean, std = reference.copy(), np.full((3, 3, 2), 0.3)
    mean[np.arange(3), nodes] += 1.0, 2.0
    mean[np.arange(3), (nodes + 1) % 3, 0] += 0.1
    std[0, 2] = 3, 4
    geometry = SimpleNamespace(
        coordinates=np.array([[4.0, 1.0], [4.0, 0.6], [4.0, 0.0]]),
        loadable=np.array([True, False, False]),
    )
    content: dict[str, Any] = {
        "surrogate": SimpleNamespace(geometry=geometry),
        "samples": SimpleNamespace(force=force, displacement=reference),
        "predicted": SimpleNamespace(mean=mean, std=std),
        "inside": np.array([0.1, 0.9, 0.4]),
    }
    return cast(Extrapolation, SimpleNamespace(**content))


def test_errors_by_distance() -> None:
    """Six components: e = (1 + 2 + 0.1) / 6; ‖(1, 2)‖ = √5; ‖(3, 4)‖ = 5 at the last node."""
    found = ErrorsByLoadDistance(three_nodes())
    assert found.order.tolist() == [1, 2, 0]
    assert found.distance == pytest.approx([0, 0.4, 1])
    assert found.mean_error == pytest.approx([3.1 / 6] * 3)
    assert found.max_error == pytest.approx([2] * 3)
    assert found.moved == pytest.approx([0.1, 0.2, 0.3])
    assert found.covered == pytest.approx([0.9, 0.4, 0.1])
    assert found.error == pytest.approx([5**0.5] * 3)
    assert found.std == pytest.approx([0.3 * 2**0.5, 0.3 * 2**0.5, 5])


def test_rows_are_the_errors_of_both_networks(
    resources: Resources, result_of: Callable[[str], Findings]
) -> None:
    """The made-up loads are all at one node of the training line: order and distance stay."""
    result = result_of("loads-away")
    rows = np.array(result.tables[0].rows, dtype=float)
    assert rows[:, 0].tolist() == list(range(1, 61))
    assert (rows[:, 1] == 0).all()
    for run, column in (("beam2d-det", 3), ("beam2d-vb", 5)):
        loads = resources.predicted_loads(run, "beam2d_away")
        error = np.abs(loads.predicted.mean - loads.samples.displacement)
        assert rows[:, column] == pytest.approx(1e3 * error.mean(axis=(1, 2)))
        assert rows[:, column + 1] == pytest.approx(1e3 * error.max(axis=(1, 2)))
    assert result.figures.keys() == {"errors", "second", "farthest"}
    assert all("8 N downwards" in caption for _, caption in result.figures.values())
    views = [result.figures[name][0].axes[0].axis() for name in ("second", "farthest")]
    assert views[0] == pytest.approx(views[1])
