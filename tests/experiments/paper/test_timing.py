from __future__ import annotations

from collections.abc import Sequence

import pytest
import torch

from experiments.framework import timing
from experiments.framework.resources import Resources
from experiments.measures import latency
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter


class Clock:
    """A clock that only the work itself moves."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    return clock


def test_median_time(clock: Clock) -> None:
    """Work of 1, 2, … s: 3 times for the warm-up; then 4, 5 and 6 s, as many as begin in 10 s."""
    calls: list[None] = []

    def work() -> None:
        calls.append(None)
        clock.sleep(len(calls))

    assert timing.median_seconds(work, timing.Timing(seconds=10)) == 5
    assert len(calls) == 6


@pytest.mark.parametrize(("drawn_anew", "times"), [(False, 1), (True, 2)])
def test_weights_are_drawn_once_or_for_every_prediction(
    resources: Resources, monkeypatch: pytest.MonkeyPatch, drawn_anew: bool, times: int
) -> None:
    """One prediction of the warm-up and one that is timed; 5 passes of every parameter."""
    surrogate = resources.surrogate("beam2d-vb")
    surrogate.predictor.passes.forget()
    draw, drawn = GaussianParameter.draw, []

    def counted(self: GaussianParameter, generators: Sequence[torch.Generator]) -> torch.Tensor:
        drawn.append(len(generators))
        return draw(self, generators)

    monkeypatch.setattr(GaussianParameter, "draw", counted)
    force = resources.dataset_of("beam2d-vb").nodal_test.force[0]
    latency.prediction_seconds(surrogate, force, 5, timing.Timing(repeats=1), drawn_anew)
    parameters = sum(isinstance(m, GaussianParameter) for m in surrogate.network.modules())
    assert drawn == times * parameters * [5]
