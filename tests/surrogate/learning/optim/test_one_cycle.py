from __future__ import annotations

import pytest
import torch

from surrogate.learning.optim.optimisers import ScheduleConfig


def one_cycle_of_torch(steps: int, warmup: float, final: float) -> list[float]:
    """Return the rates of OneCycleLR with a peak of 1; they start at 1/25 and end at `final`."""
    optimiser = torch.optim.SGD([torch.zeros(1)], lr=1.0)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        max_lr=1.0,
        total_steps=steps,
        pct_start=warmup,
        div_factor=25.0,
        final_div_factor=1 / (25 * final) if final else float("inf"),
        cycle_momentum=False,
    )
    rates = []
    for _ in range(steps):
        rates.append(optimiser.param_groups[0]["lr"])
        optimiser.step()
        scheduler.step()
    return rates


@pytest.mark.parametrize("steps", [10, 97, 1000])
@pytest.mark.parametrize("warmup", [0.3, 0.25, 0.5])
@pytest.mark.parametrize("final", [0.0, 1e-3, 0.2])
@pytest.mark.filterwarnings("ignore:.*step")
def test_one_cycle_is_that_of_torch(steps: int, warmup: float, final: float) -> None:
    schedule = ScheduleConfig(name="one_cycle", warmup=warmup, final=final)
    rates = [schedule.factor(step, steps) for step in range(steps)]
    assert rates == pytest.approx(one_cycle_of_torch(steps, warmup, final), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("warmup", [0.0, 0.1, 0.9])
@pytest.mark.parametrize("steps", [1, 2, 10])
def test_one_cycle_of_few_steps(steps: int, warmup: float) -> None:
    schedule = ScheduleConfig(name="one_cycle", warmup=warmup, final=0.1)
    assert all(1 / 25 <= schedule.factor(step, steps) <= 1 for step in range(steps))


def test_one_cycle_without_warm_up_starts_at_the_peak() -> None:
    assert ScheduleConfig(name="one_cycle").factor(0, 100) == 1.0
