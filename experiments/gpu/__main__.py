"""Command line of `experiments.gpu`: run the steps that are not done yet."""

from __future__ import annotations

import argparse
import logging
import math
import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from experiments.gpu.setting import CASES, Setting
from experiments.gpu.steps import STEPS, Step, earlier, run_steps
from shared_schema.common.command_line import run_command
from shared_schema.common.errors import InputError, WorkError
from surrogate.device import choose_device


def parser() -> argparse.ArgumentParser:
    """Make the parser."""
    result = argparse.ArgumentParser(
        prog="experiments.gpu", description="Everything that needs a GPU."
    )
    result.add_argument("out", type=Path, metavar="OUT", help="folder of the results")
    result.add_argument("--data", type=Path, default=Path("build/gpu/data"), metavar="DIR")
    result.add_argument("--device", choices=("auto", "cpu", "cuda"), default="cuda")
    result.add_argument("--small", action="store_true", help="rehearse with small networks")
    result.add_argument("--step", action="append", metavar="NAME", help="run this step (again)")
    result.add_argument("--seconds", type=float, metavar="S", help="time limit of every step")
    result.add_argument("--total", type=float, default=math.inf, metavar="S", help="of this call")
    result.add_argument("--list", action="store_true", help="list the steps")
    return result


def chosen(names: Sequence[str] | None) -> list[Step]:
    """Return the steps of some names, in their order; all without names."""
    known = [step.name for step in STEPS]
    for name in names or ():
        if name not in known:
            raise InputError(f"--step '{name}': expected one of {', '.join(known)}")
    return [step for step in STEPS if names is None or step.name in names]


def start_afresh(options: argparse.Namespace, setting: Setting, rest: Sequence[Step]) -> None:
    """Go on in a new process: after an error on a GPU, later work in this one may fail as well."""
    if not rest or not setting.on_gpu:
        return
    words = ["-m", "experiments.gpu", str(options.out), "--data", str(options.data)]
    words += ["--device", options.device, "--total", str(max(1.0, setting.seconds_left))]
    words += ["--small"] if options.small else []
    words += ["--seconds", str(options.seconds)] if options.seconds else []
    if options.step is not None:
        words += [word for step in rest for word in ("--step", step.name)]
    os.execv(sys.executable, [sys.executable, *words])


def run(options: argparse.Namespace) -> None:
    """Run the chosen steps."""
    if options.list:
        for step in STEPS:
            print(f"{step.name}\t{step.seconds:.0f} s")
        print(f"together\t{sum(step.seconds for step in STEPS):.0f} s")
        return
    for name in ("seconds", "total"):
        value = getattr(options, name)
        if value is not None and not value > 0:
            raise InputError(f"--{name} {value}: expected more than 0")
    steps, device = chosen(options.step), choose_device(options.device)
    setting = Setting(
        options.out, options.data, device, options.small, time.monotonic() + options.total
    )
    for case in CASES:
        if not any(options.data.glob(f"{case}*")):
            raise InputError(f"--data '{options.data}': no dataset of '{case}' in it")
    options.out.mkdir(parents=True, exist_ok=True)
    logging.disable(logging.WARNING)
    again = options.step is not None
    unfinished = run_steps(
        setting, steps, again, options.seconds, partial(start_afresh, options, setting)
    )
    failed = [step.name for step in steps if "error" in earlier(options.out, step)]
    if unfinished:
        print(f"to be gone on with, by the same command: {', '.join(unfinished)}")
    elif not again:
        print("all steps are done")
    if failed:
        raise WorkError(f"steps with errors (in their JSON files): {', '.join(failed)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    options = parser().parse_args(arguments)
    return run_command("experiments.gpu", lambda: run(options))


if __name__ == "__main__":
    sys.exit(main())
