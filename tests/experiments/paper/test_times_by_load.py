from __future__ import annotations

import numpy as np
import pytest

from experiments.measures.solutions import Solutions
from experiments.paper.prediction_times import (
    Ends,
    TimesByLoad,
    load_table,
    predicting_does_not,
    solving_ends,
    solving_grows,
)

SAME, TWICE = Ends(1.0, 1.0), Ends(1.0, 2.0)


def test_ends_are_medians_of_tenths() -> None:
    """Loads 0 … 29 N in random order, F² + 1 s, F + 1 iterations: of 0, 1, 2 and 27, 28, 29 N."""
    force = np.random.default_rng(0).permutation(30).astype(float)
    solving, iterations = solving_ends(Solutions(force, force**2 + 1, force.astype(int) + 1))
    assert solving == Ends(2e3, 785e3)
    assert iterations == Ends(2, 29)
    assert iterations.ratio == 14.5


def test_rows() -> None:
    times = {"beam2d": TimesByLoad(TWICE, Ends(4.0, 6.0), {"D": SAME, "VB": TWICE})}
    assert load_table(times).rows == (
        ("2D beam", "t_FEM [ms]", 1, 2, 2),
        ("2D beam", "Newton iterations", 4, 6, 1.5),
        ("2D beam", "prediction (D) [ms]", 1, 1, 1),
        ("2D beam", "prediction (VB) [ms]", 1, 2, 2),
    )


@pytest.mark.parametrize(("large", "grows"), [(1.19, False), (1.2, True)])
def test_finite_elements_take_longer_by_a_fifth(large: float, grows: bool) -> None:
    times = {
        "beam2d": TimesByLoad(TWICE, SAME, {}),
        "beam3d": TimesByLoad(Ends(1.0, large), SAME, {}),
    }
    assert solving_grows(times).holds is grows


@pytest.mark.parametrize(
    ("large", "same"), [(0.83, False), (0.84, True), (1.19, True), (1.2, False)]
)
def test_predictions_take_as_long_within_a_fifth(large: float, same: bool) -> None:
    times = {
        "beam2d": TimesByLoad(TWICE, SAME, {"D": SAME, "VB": Ends(1.0, large)}),
        "beam3d": TimesByLoad(TWICE, SAME, {"D": SAME}),
    }
    assert predicting_does_not(times).holds is same
