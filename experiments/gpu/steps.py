"""The steps in their order, and the loop that runs those that are not done yet."""

from __future__ import annotations

import json
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from experiments.gpu.fast_recipes import fast_recipe
from experiments.gpu.gpu_tests import gpu_tests
from experiments.gpu.latency import latency
from experiments.gpu.one_process import one_process
from experiments.gpu.paper_recipes import constant_channels, paper_recipe
from experiments.gpu.setting import Results, Setting, described_machine
from experiments.gpu.step_profile import step_profile
from experiments.gpu.throughput import throughput
from shared_schema.common.atomic_file import write_text

LEAST = 15.0  # s; with less time left, a step is not begun


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes
    ----------
    name : str
        Name of the step, and of its JSON file.
    seconds : float
        Time that it may take on a GPU, over all calls.
    work : callable
        Does it and returns its results. With ``"finished": False``, the next call goes on with it.
    """

    name: str
    seconds: float
    work: Callable[[Setting], Results]


STEPS = (
    Step("gpu-tests", 120, gpu_tests),
    Step("latency", 100, latency),
    Step("throughput", 100, throughput),
    Step("profile", 40, step_profile),
    Step("fast-beam2d-det", 50, fast_recipe("beam2d-det-fast")),
    Step("fast-lshape2d-det", 40, fast_recipe("lshape2d-det-fast")),
    Step("paper-beam2d-det", 480, paper_recipe("beam2d-det-paper")),
    Step("paper-lshape2d-det", 270, paper_recipe("lshape2d-det-paper")),
    Step("paper-beam2d-mle", 40, paper_recipe("beam2d-mle-paper")),
    Step("paper-beam2d-vb", 80, paper_recipe("beam2d-vb-paper")),
    Step("beam3d-c64", 60, constant_channels(64)),
    Step("paper-beam3d-det", 80, paper_recipe("beam3d-det-paper")),
    Step("one-process", 60, one_process),
    Step("paper-lshape2d-mle", 40, paper_recipe("lshape2d-mle-paper")),
    Step("paper-lshape2d-vb", 80, paper_recipe("lshape2d-vb-paper")),
)


def result_path(out: Path, step: Step) -> Path:
    """Path of the JSON file of a step."""
    return out / f"{step.name}.json"


def earlier(out: Path, step: Step) -> Results:
    """Result of a step from an earlier call; empty if there is none."""
    path = result_path(out, step)
    return dict(json.loads(path.read_text())) if path.is_file() else {}


def run_steps(
    setting: Setting,
    steps: Sequence[Step],
    again: bool,
    seconds: float | None,
    after_error: Callable[[Sequence[Step]], None] = lambda _: None,
) -> list[str]:
    """Run steps one after the other until the setting's deadline; return the unfinished ones.

    A step that fails leaves its traceback in its result, and the next step follows.

    Parameters
    ----------
    setting : Setting
    steps : sequence of Step
    again : bool
        Run steps that are done, too.
    seconds : float, optional
        Time limit of every step instead of its own.
    after_error : callable
        Function that is called with the following steps after one that has failed.
    """
    unfinished = []
    for number, step in enumerate(steps, start=1):
        before = {} if again else earlier(setting.out, step)
        if before.get("finished"):
            say(f"{step.name}: done")
            continue
        spent, own = before.get("seconds", 0.0), seconds or step.seconds
        left = min(own - spent, setting.seconds_left)
        if setting.seconds_left < LEAST:
            unfinished.append(step.name)
            continue
        say(f"{step.name}: {left:.0f} s at most")
        began = time.monotonic()
        described = described_machine(setting.device)
        try:
            results = step.work(replace(setting, deadline=began + left))
        except Exception:  # whatever one step does wrong, the others are worth their time
            results = {"error": traceback.format_exc()}
        spent += time.monotonic() - began
        finished = results.get("finished", True) or spent > 0.9 * own
        results |= {"finished": finished, "seconds": round(spent, 2)}
        content = {"step": step.name, "small": setting.small, "machine": described, **results}
        write_text(result_path(setting.out, step), json.dumps(content, indent=1) + "\n")
        say(f"{step.name}: {'FAILED' if 'error' in results else 'done' if finished else 'begun'}")
        if not finished:
            unfinished.append(step.name)
        if "error" in results:
            after_error(steps[number:])
    return unfinished


def say(line: str) -> None:
    """Print a line with the time."""
    print(f"{time.strftime('%H:%M:%S')} {line}", file=sys.stderr, flush=True)
