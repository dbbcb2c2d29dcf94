from __future__ import annotations

from collections.abc import Callable

import pytest

from experiments.framework.experiment import Findings
from experiments.paper.prediction_times import PassTimes, pass_comparisons


def test_times_and_ratios(result_of: Callable[[str], Findings]) -> None:
    """0.5 s and one iteration for every made-up sample, small load or large; no GPU."""
    result = result_of("prediction-times")
    times, by_load, passes = result.tables
    for row in times.rows[::2]:
        median, largest, cpu, gpu, by_cpu, by_gpu = row[2:]
        assert (median, largest, gpu, by_gpu) == (500, 500, None, None)
        assert isinstance(cpu, float)
        assert by_cpu == pytest.approx(500 / cpu)
    solving = [row[1:] for row in by_load.rows if "prediction" not in str(row[1])]
    assert solving == 3 * [("t_FEM [ms]", 500, 500, 1), ("Newton iterations", 1, 1, 1)]
    assert [row[1] for row in by_load.rows].count("prediction (VB) [ms]") == 2
    for _, how, count, whole, one, _ in passes.rows:
        assert count == (300 if how == "paper" else 4 * 4)  # four networks, four passes each
        assert isinstance(one, float)
        assert isinstance(count, int)
        assert whole == pytest.approx(count * one)
    assert [c.paper for c in result.comparisons] == [5, 7, 100]
    *fast, grows, _ = result.claims
    assert [claim.holds for claim in fast] == 3 * [True]
    assert not grows.holds


def test_passes_are_compared_with_as_many_of_the_paper() -> None:
    """Both times of 300 passes beside the paper's 100 ms; with 4 passes there is no comparison."""
    found = pass_comparisons({"beam2d": PassTimes(1200, 60.0, 160.0)})
    assert [(c.ours, c.paper, c.verdict) for c in found] == [
        (60.0, 100.0, "better"),
        (160.0, 100.0, "differs"),
    ]
