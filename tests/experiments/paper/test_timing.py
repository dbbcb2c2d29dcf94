from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments.framework import timing
from experiments.framework.resources import Resources
from experiments.framework.scale import read_scale
from experiments.measures import latency
from experiments.measures.solutions import read_solutions
from experiments.paper.catalogue import REPRODUCTION
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


def test_times_in_turn(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """Works of 20 and 1 s, until the first has taken 50 s: three times."""
    monkeypatch.setattr(timing, "WARM_UP", 0)
    calls: list[str] = []

    def work(name: str, seconds: float) -> None:
        calls.append(name)
        clock.sleep(seconds)

    works = [partial(work, "a", 20.0), partial(work, "b", 1.0)]
    assert timing.alternating_seconds(works, timing.Timing(seconds=50)) == [20, 1]
    assert calls == 3 * ["a", "b"]


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


def test_solutions(make_dataset: Callable[..., Path], tmp_path: Path) -> None:
    """The made-up dataset has 0.5 s and one iteration; samples ascend."""
    forces = np.stack([np.arange(60.0), np.zeros(60)], axis=1)
    solutions = read_solutions(make_dataset(tmp_path, corner_forces=forces).parent / "nodal")
    assert solutions.force.tolist() == list(range(60))
    assert solutions.seconds.tolist() == 60 * [0.5]
    assert solutions.iterations.tolist() == 60 * [1]


def test_repeats_end_the_timing() -> None:
    """Five repeats after the three of the warm-up; two after as many."""
    for repeats, expected in ((5, 8), (2, 4)):
        calls: list[None] = []
        timing.median_seconds(lambda: calls.append(None), timing.Timing(repeats=repeats))  # noqa: B023
        assert len(calls) == expected


def test_timing_of_the_scales() -> None:
    """200 repeats or 5 s, at the scale `smoke` one repeat."""
    assert (
        read_scale("laptop", REPRODUCTION.scales).timing
        == read_scale("paper", REPRODUCTION.scales).timing
        == timing.Timing()
    )
    assert (timing.Timing().repeats, timing.Timing().seconds) == (200, 5.0)
    smoke = read_scale("smoke", REPRODUCTION.scales).timing
    assert (smoke.repeats, smoke.seconds) == (1, 0.05)
