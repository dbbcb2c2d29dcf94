from __future__ import annotations

import numpy as np
import pytest

from surrogate.learning.measures.force_sweep import find_example, tip_measures

TIP = 2


def samples() -> tuple[np.ndarray, np.ndarray]:
    """Loads at the nodes 2, 2, 2, 1 of three; the tip moves by 0.2, 0.5, 1.0, 0.8 m."""
    force, displacement = np.zeros((4, 3, 2)), np.zeros((4, 3, 2))
    force[np.arange(4), [2, 2, 2, 1], 1] = 1.0
    displacement[:, TIP, 0] = 0.2, -0.5, 1.0, 0.8
    return force, displacement


@pytest.mark.parametrize(
    ("nodes", "aim", "found"),
    [
        ([2], 0.85, 2),  # sample 3 is nearer, but loaded elsewhere
        ([2], 0.3, 0),
        ([1, 2], 0.85, 3),
        ([0], 0.85, 3),  # never loaded: any sample
        ([2], None, 1),  # three quarters of 1 m lie between 0.5 and 1 m: the first
    ],
)
def test_nearest_tip_displacement(nodes: list[int], aim: float | None, found: int) -> None:
    assert find_example(*samples(), TIP, np.array(nodes), aim) == found


def test_tip_measures() -> None:
    """‖(0, 5) − (3, 4)‖ / ‖(3, 4)‖ = √10 / 5; for a tip that does not move, 0."""
    reference, predicted = np.zeros((3, 2)), np.zeros((3, 2))
    reference[TIP], predicted[TIP] = (3, 4), (0, 5)
    assert tip_measures(predicted, reference, TIP) == pytest.approx((5, 10**0.5 / 5))
    assert tip_measures(predicted, 0 * reference, TIP) == (0, 0)
