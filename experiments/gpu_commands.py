"""Commands gpu run, pack, archive and report: everything that needs a GPU (`experiments.gpu`)."""

from __future__ import annotations

import argparse
import math
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.framework.quiet import only_errors
from shared_schema.common import Commands, InputError, WorkError, add_command

if TYPE_CHECKING:
    from experiments.framework.experiment import Experiment
    from experiments.gpu.setting import GpuSetting


def add_to(commands: Commands) -> None:
    """Add the parsers."""
    gpu = add_command(
        commands, "gpu", "measure what needs a GPU", "python -m experiments gpu run OUT"
    )
    inner = gpu.add_subparsers(required=True, metavar="COMMAND")
    steps = add_command(
        inner,
        "run",
        "measure the steps that are not done yet",
        "python -m experiments gpu run OUT --total 540",
    )
    steps.add_argument("out", type=Path, metavar="OUT", help="folder of the results")
    steps.add_argument("--data", type=Path, default=Path("build/gpu/data"), metavar="DIR")
    steps.add_argument("--device", choices=("auto", "cpu", "cuda"), default="cuda")
    steps.add_argument("--small", action="store_true", help="rehearse with small networks")
    steps.add_argument("--step", action="append", metavar="NAME", help="run this step (again)")
    steps.add_argument("--seconds", type=float, metavar="S", help="time limit of every step")
    steps.add_argument("--total", type=float, default=math.inf, metavar="S", help="of this call")
    steps.add_argument("--list", action="store_true", help="list the steps")
    steps.set_defaults(command=run_steps)
    pack = add_command(
        inner,
        "pack",
        "make the folder that is carried to the machine with the GPU",
        "python -m experiments gpu pack build/gpu --data data",
    )
    pack.add_argument("folder", type=Path, metavar="FOLDER")
    pack.add_argument("--data", type=Path, default=Path("data"), help="datasets of make data")
    pack.add_argument("--samples", type=int, help="number of samples of each body in space")
    runs = "runs whose frames a second are measured"
    pack.add_argument("--runs", type=Path, nargs="+", default=[], metavar="RUN", help=runs)
    pack.add_argument("--no-wheels", action="store_true", help="pack the datasets only")
    pack.set_defaults(command=run_pack)
    archive = add_command(
        inner,
        "archive",
        "put the results into one small file",
        "python -m experiments gpu archive OUT FOLDER",
    )
    archive.add_argument("out", type=Path, metavar="OUT", help="folder of the results")
    archive.add_argument("folder", type=Path, metavar="FOLDER")
    archive.add_argument("--weights", nargs="+", default=[], metavar="RUN", help="runs to carry")
    archive.set_defaults(command=run_archive)
    report = add_command(
        inner,
        "report",
        "make a page from the records of the steps",
        "python -m experiments gpu report docs/results/gpu docs/gpu-results.md",
    )
    report.add_argument("records", type=Path, metavar="FOLDER", help="folder of the records")
    report.add_argument("page", type=Path, metavar="FILE")
    report.set_defaults(command=run_report)


def run_steps(options: argparse.Namespace) -> None:
    """Measure the chosen steps."""
    from experiments.framework.runner import find, run
    from experiments.gpu.catalogue import STEPS
    from experiments.gpu.setting import CASES, GpuSetting
    from surrogate.runtime.device import choose_device

    if options.list:
        for step in STEPS:
            print(f"{step.name}\t{step.seconds:.0f} s")
        print(f"together\t{sum(step.seconds for step in STEPS):.0f} s")
        return
    for name in ("seconds", "total"):
        value = getattr(options, name)
        if value is not None and not value > 0:
            raise InputError(f"--{name} {value}: expected more than 0")
    steps = list(STEPS) if options.step is None else find(STEPS, options.step)
    deadline = time.monotonic() + options.total
    device = choose_device(options.device)
    setting = GpuSetting(options.out, options.data, device, options.small, deadline)
    for case in CASES:
        if not any(options.data.glob(f"{case}*")):
            raise InputError(f"--data '{options.data}': no dataset of '{case}' in it")
    with only_errors("surrogate"):
        outcome = run(
            steps,
            setting,
            options.out,
            command=shlex.join(["python", "-m", "experiments", *sys.argv[1:]]),
            again=options.step is not None,
            seconds=options.seconds,
            after_error=lambda rest: start_afresh(options, setting, rest),
        )
    if outcome.unfinished:
        print(f"to be gone on with, by the same command: {', '.join(outcome.unfinished)}")
    elif options.step is None:
        print("all steps are done")
    if outcome.failed:
        raise WorkError(f"steps with errors (in their JSON files): {', '.join(outcome.failed)}")


def start_afresh(
    options: argparse.Namespace, setting: GpuSetting, rest: Sequence[Experiment[GpuSetting]]
) -> None:
    """Go on in a new process: after an error on a GPU, later work in this one may fail as well."""
    if not rest or not setting.on_gpu:
        return
    words = ["-m", "experiments", "gpu", "run", str(options.out), "--data", str(options.data)]
    words += ["--device", options.device, "--total", str(max(1.0, setting.seconds_left))]
    words += ["--small"] if options.small else []
    words += ["--seconds", str(options.seconds)] if options.seconds else []
    if options.step is not None:
        words += [word for step in rest for word in ("--step", step.name)]
    os.execv(sys.executable, [sys.executable, *words])


def run_pack(options: argparse.Namespace) -> None:
    """Fill the folder."""
    from experiments.gpu.pack import make

    make(options.folder, options.data, options.samples, options.runs, not options.no_wheels)


def run_archive(options: argparse.Namespace) -> None:
    """Write the files, and print their paths."""
    from experiments.gpu.archive import archive

    for path in archive(options.out, options.folder, options.weights):
        print(path)


def run_report(options: argparse.Namespace) -> None:
    """Write the page."""
    from experiments.gpu.report import write_report

    write_report(options.records, options.page)
