"""Commands study, reproduce and beyond: the paper's tables and figures, and what goes beyond."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, Parser, add_command, add_set
from surrogate.commands.options import add_device

if TYPE_CHECKING:
    from experiments.framework.studies_report import Report
    from experiments.framework.study import Study


def add_to(commands: Commands) -> None:
    """Add the three parsers."""
    study = add_command(
        commands,
        "study",
        "do some studies of one of the two reports",
        "python -m experiments study force-sweep-beam --scale smoke",
    )
    study.add_argument("names", nargs="+", metavar="NAME", help="study, such as force-sweep-beam")
    _add_options(study)
    study.add_argument("--again", action="store_true", help="repeat studies that are up to date")
    study.set_defaults(command=run_some)

    for name, run, what in (
        ("reproduce", run_reproduction, "make all of the paper's tables and figures"),
        ("beyond", run_beyond, "do all studies beyond the paper"),
    ):
        whole = add_command(commands, name, what, f"python -m experiments {name} --scale smoke")
        _add_options(whole)
        whole.add_argument(
            "--list-data", action="store_true", help="print the commands that make missing datasets"
        )
        whole.set_defaults(command=run)


def _add_options(parser: Parser) -> None:
    parser.add_argument(
        "--scale",
        default="laptop",
        metavar="NAME",
        help="smoke, laptop, paper (reproduction), plane, space or day (beyond), or a YAML file",
    )
    add_set(parser, "the scale", "passes=100")
    parser.add_argument("--data", type=Path, default=Path("data"), metavar="DIR", help="datasets")
    parser.add_argument("--runs", type=Path, default=Path("runs"), metavar="DIR", help="networks")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="report (default docs/reproduction/SCALE or docs/beyond/SCALE)",
    )
    add_device(parser)


def run_some(options: argparse.Namespace) -> None:
    """Do the studies that are named."""
    from experiments.framework.run_report import find_report, find_studies

    _do(options, find_report(options.names), find_studies(options.names), options.again)


def run_reproduction(options: argparse.Namespace) -> None:
    """Do all studies of the paper."""
    from experiments.paper.catalogue import REPRODUCTION

    _do_all(options, REPRODUCTION)


def run_beyond(options: argparse.Namespace) -> None:
    """Do all studies beyond the paper."""
    from experiments.beyond.catalogue import BEYOND

    _do_all(options, BEYOND)


def _do_all(options: argparse.Namespace, report: Report) -> None:
    from experiments.framework.data_commands import missing_data
    from experiments.framework.scale import read_scale

    if options.list_data:
        scale = read_scale(options.scale, report.scales, options.changes)
        for line in missing_data(scale, options.data):
            print(line)
    else:
        _do(options, report, report.studies)


def _do(
    options: argparse.Namespace, report: Report, studies: Sequence[Study], again: bool = False
) -> None:
    from experiments.framework.resources import Resources
    from experiments.framework.run_report import reproduce
    from experiments.framework.scale import read_scale
    from experiments.framework.studies_report import PAGE
    from surrogate.device import choose_device

    scale = read_scale(options.scale, report.scales, options.changes)
    device = choose_device(options.device)
    out = options.out or Path("docs", report.name, scale.name)
    require_writable(out)
    require_writable(options.runs, "--runs")
    resources = Resources(scale, options.data, options.runs, device)
    done = reproduce(studies, resources, out, again, report)
    state = f"{done} done now, " if done else ""
    print(f"{out / PAGE}: {state}{len(studies) - done} of {len(studies)} studies up to date")
