from __future__ import annotations

import pytest

from surrogate.studies import timing
from surrogate.studies.prediction_times import conduct
from surrogate.studies.workshop import Workshop


def test_times_and_ratios(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """0.5 s and one iteration for every made-up sample, small load or large; no GPU."""
    monkeypatch.setattr(timing, "WARM_UP", 0)
    monkeypatch.setattr(timing, "SECONDS", 1e-9)
    outcome = conduct(workshop)
    times, by_load, passes = outcome.tables
    for row in times.rows[::2]:
        median, largest, cpu, gpu, by_cpu, by_gpu = row[2:]
        assert (median, largest, gpu, by_gpu) == (500, 500, None, None)
        assert isinstance(cpu, float)
        assert by_cpu == pytest.approx(500 / cpu)
    solving = [row[1:] for row in by_load.rows if "prediction" not in str(row[1])]
    assert solving == 3 * [("t_FEM [ms]", 500, 500, 1), ("Newton iterations", 1, 1, 1)]
    assert [row[1] for row in by_load.rows].count("prediction (VB) [ms]") == 2
    for _, how, count, whole, one, _ in passes.rows:
        assert count == (300 if how == "paper" else 4 * 300)  # four networks
        assert isinstance(one, float)
        assert isinstance(count, int)
        assert whole == pytest.approx(count * one)
    assert [row[3] for row in passes.rows[:-1]] == [c.ours for c in outcome.comparisons[3:]]
    assert [c.paper for c in outcome.comparisons] == [5, 7, 100, 100, 100, 100, 100]
    *fast, grows, _ = outcome.claims
    assert [claim.holds for claim in fast] == 3 * [True]
    assert not grows.holds
