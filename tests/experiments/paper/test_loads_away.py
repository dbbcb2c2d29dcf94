from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.framework.resources import Resources
from experiments.measures.vertical_force import describe_vertical_force
from experiments.paper.loads_away import (
    ErrorsByLoadDistance,
    drop_claim,
    growth_claim,
    low_claim,
    uncertainty_claim,
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


def test_force_describe_vertical_force() -> None:
    force = np.zeros((3, 2))
    force[1, 1] = 1.5
    assert describe_vertical_force(force) == "1.5 N upwards"
    assert describe_vertical_force(-5 * force) == "7.5 N downwards"


def test_growth_and_drop() -> None:
    """Two orders of magnitude: a factor of 10^1.5 = 32 or more, in either error."""
    rising, other = np.array([1.0, 2.0, 20.0, 33.0]), np.array([1.0, 3.0, 2.0, 31.0])
    assert growth_claim(rising).holds
    assert not growth_claim(other).holds
    assert drop_claim(rising, other).holds
    assert drop_claim(other, rising).holds
    assert drop_claim(100 * rising - 99, other).holds
    assert drop_claim(other, other).verdict == "better"


def test_uncertainty_is_unreliable_where_most_errors_are_outside_the_band() -> None:
    error, std = np.array([1.0, 8.0, 20.0]), np.array([1.0, 9.0, 11.0])
    claim = uncertainty_claim(np.array([0.9, 0.125, 0.49]), error, std)
    assert claim.holds
    assert "90 % of the components" in claim.evidence
    assert "12.5, 49 %" in claim.evidence
    assert "the farthest node ‖σ‖₂ grows 11 times, ‖U − u‖₂ 20 times" in claim.evidence
    assert uncertainty_claim(np.array([0.9, 0.1, 0.51]), error, std).verdict == "better"


@pytest.mark.parametrize(("farthest", "low"), [(4.9, True), (5.1, False), (20.0, False)])
def test_low_uncertainty_at_the_farthest_node(farthest: float, low: bool) -> None:
    """Half of the largest at the others, 10 m."""
    assert low_claim(np.array([1.0, 10.0, farthest])).holds == low
