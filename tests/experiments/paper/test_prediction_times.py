from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.framework.experiment import Findings
from experiments.measures.solutions import Solutions
from experiments.paper.prediction_times import (
    PAPER_TIMES,
    Ends,
    PassTimes,
    Times,
    TimesByLoad,
    faster,
    load_table,
    pass_comparisons,
    solving_ends,
)


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


def test_the_papers_ratios() -> None:
    """Table "Tab: prediction_times": 25, 17, 31 on CPUs and 123, 120, 345 on GPUs."""
    ratios = [paper.cells()[4:] for paper in PAPER_TIMES.values()]
    expected = [(24.6, 123.0), (17.14, 120.0), (31.0, 344.4)]
    assert ratios == [pytest.approx(pair, rel=1e-3) for pair in expected]


@pytest.mark.parametrize(("device", "least"), [("CPU", 10), ("GPU", 100)])
def test_faster_by_as_much_as_the_paper_says(device: str, least: float) -> None:
    """At least 10 and 100 times; both numbers in the evidence."""
    paper = PAPER_TIMES["beam3d"]
    assert faster("3D beam", device, paper, paper).holds
    claim = faster("3D beam", device, Times(3.0 * least, 60.0 * least, {device: 3.0}), paper)
    assert claim.holds
    assert f"= {least} ({3 * least} / 3 ms); of the slowest load {20 * least};" in claim.evidence
    assert f"the paper: {paper.speed_up(device):.3g} (3100 / " in claim.evidence
    assert not faster("3D beam", device, Times(3.0 * least, None, {device: 3.1}), paper).holds


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
