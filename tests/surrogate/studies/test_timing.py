from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from surrogate.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.studies import timing
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


def test_times_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Works of 20 and 1 ms, until the first has taken 50 ms."""
    monkeypatch.setattr(timing, "SECONDS", 0.05)
    monkeypatch.setattr(timing, "WARM_UP", 0)
    calls: list[str] = []

    def work(name: str, seconds: float) -> None:
        calls.append(name)
        time.sleep(seconds)

    slow, quick = timing.alternating_seconds([partial(work, "a", 0.02), partial(work, "b", 0.001)])
    assert quick < 0.02 <= slow
    assert calls == len(calls) // 2 * ["a", "b"]


@pytest.mark.parametrize(("drawn_anew", "times"), [(False, 1), (True, 4)])
def test_weights_are_drawn_once_or_for_every_prediction(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch, drawn_anew: bool, times: int
) -> None:
    """Predictions are three of the warm-up and one that is timed; 5 passes of every parameter."""
    monkeypatch.setattr(timing, "SECONDS", 1e-9)
    surrogate = workshop.surrogate("beam2d-vb")
    surrogate.passes.forget()
    draw, drawn = GaussianParameter.draw, []

    def counted(self: GaussianParameter, generators: Sequence[torch.Generator]) -> torch.Tensor:
        drawn.append(len(generators))
        return draw(self, generators)

    monkeypatch.setattr(GaussianParameter, "draw", counted)
    force = workshop.dataset_of("beam2d-vb").nodal_test.force[0]
    timing.prediction_seconds(surrogate, force, 5, drawn_anew)
    parameters = sum(isinstance(m, GaussianParameter) for m in surrogate.network.modules())
    assert drawn == times * parameters * [5]


def test_solutions(make_dataset: Callable[..., Path], tmp_path: Path) -> None:
    """The made-up dataset's: 0.5 s, one iteration; samples in the order of their numbers."""
    forces = np.stack([np.arange(60.0), np.zeros(60)], axis=1)
    solutions = timing.read_solutions(make_dataset(tmp_path, corner_forces=forces).parent / "nodal")
    assert solutions.force.tolist() == list(range(60))
    assert solutions.seconds.tolist() == 60 * [0.5]
    assert solutions.iterations.tolist() == 60 * [1]
