from __future__ import annotations

import pytest

from experiments.paper.prediction_times import PAPER_TIMES, Times, faster, real_time


def test_the_papers_ratios() -> None:
    """Table "Tab: prediction_times": 25, 17, 31 on CPUs and 123, 120, 345 on GPUs."""
    ratios = [paper.cells()[4:] for paper in PAPER_TIMES.values()]
    expected = [(24.6, 123.0), (17.14, 120.0), (31.0, 344.4)]
    assert ratios == [pytest.approx(pair, rel=1e-3) for pair in expected]


def test_no_gpu() -> None:
    assert Times(6.0, 8.0, {"CPU": 2.0}).cells() == (6, 8, 2, None, 3, None)


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


@pytest.mark.parametrize(("gpu", "holds"), [(9.0, True), (11.0, False)])
def test_real_time(gpu: float, holds: bool) -> None:
    """The paper's limit of 10 ms."""
    assert real_time("3D beam", gpu, 9.0).holds is holds
