"""Commands of the studies: reproduce, beyond, organs, study; published for the paper's numbers."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from shared_schema.common import Commands, Parser, add_command, add_set, require_writable

if TYPE_CHECKING:
    from experiments.framework.experiment import Experiment
    from experiments.framework.report import Report
    from experiments.framework.resources import Resources
    from experiments.framework.scale import Scale


def add_to(commands: Commands) -> None:
    """Add the parsers."""
    for name, what in (
        ("reproduce", "make all of the paper's tables and figures"),
        ("beyond", "do all studies beyond the paper"),
        ("organs", "do all studies of organs"),
    ):
        whole = add_command(commands, name, what, f"python -m experiments {name} --scale smoke")
        _add_options(whole)
        whole.add_argument(
            "--list-data", action="store_true", help="print the commands that make missing datasets"
        )
        whole.set_defaults(command=run_all, report=name)
    study = add_command(
        commands,
        "study",
        "do some studies of one of the reports",
        "python -m experiments study force-sweep-beam --scale smoke",
    )
    study.add_argument("names", nargs="+", metavar="NAME", help="study, such as force-sweep-beam")
    _add_options(study)
    study.add_argument("--again", action="store_true", help="repeat studies that are up to date")
    study.set_defaults(command=run_some)
    published = add_command(
        commands,
        "published",
        "print the paper's numbers for a run, for surrogate evaluate and report --beside",
        "python -m experiments published runs/beam2d > published.yaml",
    )
    published.add_argument("run", type=Path, metavar="RUN", help="run folder")
    published.set_defaults(command=run_published)
    evidence = add_command(
        commands,
        "evidence",
        "write docs/evidence.md: requirements, their tests, what was measured",
        "python -m experiments evidence",
    )
    evidence.set_defaults(command=run_evidence)


def _add_options(parser: Parser) -> None:
    parser.add_argument(
        "--scale",
        default="laptop",
        metavar="NAME",
        help="smoke, laptop, paper (reproduction), plane, space, day (beyond), or a YAML file",
    )
    add_set(parser, "the scale", "passes=100")
    parser.add_argument("--data", type=Path, default=Path("data"), metavar="DIR", help="datasets")
    parser.add_argument("--runs", type=Path, default=Path("runs"), metavar="DIR", help="networks")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="report (default docs/reproduction/SCALE, docs/beyond/SCALE or docs/organs/SCALE)",
    )
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="processor; auto (default) takes a GPU if there is one",
    )


def run_all(options: argparse.Namespace) -> None:
    """Do all studies of a report, or list what makes their datasets."""
    from experiments.catalogue import REPORTS
    from experiments.framework.data_commands import missing_data

    report = REPORTS[options.report]
    if options.list_data:
        for line in missing_data(_scale(options, report), options.data):
            print(line)
    else:
        _do(options, report)


def run_some(options: argparse.Namespace) -> None:
    """Do the studies that are named."""
    from experiments.catalogue import find_studies

    report, studies = find_studies(options.names)
    _do(options, report, studies, options.again)


def run_published(options: argparse.Namespace) -> None:
    """Print the numbers as YAML; an empty mapping for a case that the paper does not have."""
    from experiments.paper.published_numbers import PAPER, as_yaml
    from surrogate.learning.runs import RunFolder, find_run

    of = RunFolder(find_run(options.run)).description().run
    print(as_yaml(PAPER.published(of.case, of.likelihood)), end="")


def run_evidence(options: argparse.Namespace) -> None:
    """Write the page of evidence."""
    from experiments.evidence.page import PAGE, write_page

    write_page()
    print(PAGE)


def _scale(options: argparse.Namespace, report: Report) -> Scale:
    from experiments.framework.scale import read_scale

    return read_scale(options.scale, report.scales, options.changes)


def _do(
    options: argparse.Namespace,
    report: Report,
    studies: Sequence[Experiment[Resources]] | None = None,
    again: bool = False,
) -> None:
    """Do some studies, or all that the scale has networks of."""
    from experiments.framework.report import PAGE, write_current
    from experiments.framework.resources import Resources
    from experiments.framework.runner import run
    from surrogate.runtime.device import choose_device

    scale = _scale(options, report)
    studies = report.studies_at(scale) if studies is None else studies
    out = options.out or Path("docs", report.name, scale.name)
    require_writable(out)
    require_writable(options.runs, "--runs")
    resources = Resources(scale, options.data, options.runs, choose_device(options.device))
    command = shlex.join(["python", "-m", "experiments", *sys.argv[1:]])
    outcome = run(
        studies,
        resources,
        out,
        command=command,
        again=again,
        after=lambda: write_current(report, resources, out),
    )
    if outcome.done == 0:
        write_current(report, resources, out)
    done = outcome.done
    state = f"{done} done now, " if done else ""
    print(f"{out / PAGE}: {state}{len(studies) - done} of {len(studies)} studies up to date")
