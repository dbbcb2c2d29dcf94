from __future__ import annotations

import time

import pytest

from surrogate.studies import timing
from surrogate.studies.prediction_times import Times, conduct, faster, real_time
from surrogate.studies.workshop import Workshop


def test_median_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 ms, done three times before and as often as there is time for: 3 times in 50 ms."""
    monkeypatch.setattr(timing, "SECONDS", 0.05)
    calls: list[None] = []

    def work() -> None:
        calls.append(None)
        time.sleep(0.02)

    assert 0.02 <= timing.median_seconds(work) < 0.1
    assert 4 <= len(calls) <= 6


def test_ratios_are_to_the_solvers_times(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """0.5 s for every made-up sample; on a machine without GPU there are dashes."""
    monkeypatch.setattr(timing, "SECONDS", 0.05)
    outcome = conduct(workshop)
    table, passes = outcome.tables
    for row in table.rows[::2]:
        median, largest, cpu, gpu, by_cpu, by_gpu = row[2:]
        assert (median, largest, gpu, by_gpu) == (500, 500, None, None)
        assert isinstance(cpu, float)
        assert by_cpu == pytest.approx(500 / cpu)
    for _, whole, one in passes.rows:
        assert isinstance(one, float)
        assert whole == pytest.approx(300 * one)
    assert [claim.holds for claim in outcome.claims] == 3 * [True]


def test_the_papers_numbers(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """Table "Tab: prediction_times": ratios 25, 17, 31 on CPUs and 123, 120, 345 on GPUs."""
    monkeypatch.setattr(timing, "SECONDS", 0.05)
    outcome = conduct(workshop)
    ratios = [row[6:] for row in outcome.tables[0].rows[1::2]]
    expected = [(24.6, 123.0), (17.14, 120.0), (31.0, 344.4)]
    assert ratios == [pytest.approx(pair, rel=1e-3) for pair in expected]
    assert [c.paper for c in outcome.comparisons] == [5, 7, 100, 100, 100]


@pytest.mark.parametrize(("cpu", "holds"), [(0.9, True), (1.1, False)])
def test_faster_than_finite_elements(cpu: float, holds: bool) -> None:
    paper = Times(123.0, None, 5.0, 1.0)
    assert faster("2D beam", Times(1.0, 2.0, cpu, None), paper).holds is holds


@pytest.mark.parametrize(("gpu", "holds"), [(9.0, True), (11.0, False)])
def test_real_time(gpu: float, holds: bool) -> None:
    """The paper's limit of 10 ms."""
    assert real_time("3D beam", gpu, 9.0).holds is holds
