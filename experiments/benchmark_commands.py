"""Commands benchmark, and list for all experiments."""

from __future__ import annotations

import argparse
import ast
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.framework.machine import ROOT
from shared_schema.common import Commands, InputError, add_command

if TYPE_CHECKING:
    from experiments.benchmarks.benchmark import Benchmark

PROGRAMS = {  # in whose environment a benchmark is measured
    "actuators": "surrogate",
    "certificates": "surrogate",
    "claims": "surrogate",
    "control": "surrogate",
    "corrections": "datagen",
    "directions": "surrogate",
    "elements": "datagen",
    "equilibrium": "datagen",
    "error-over-time": "surrogate",
    "grips": "surrogate",
    "hidden-test": "surrogate",
    "identification": "surrogate",
    "large-bodies": "datagen",
    "manufactured": "datagen",
    "materials": "surrogate",
    "measured-beam": "surrogate",
    "measured-swing": "surrogate",
    "motion": "surrogate",
    "new-shape": "surrogate",
    "normalisation": "surrogate",
    "page": "surrogate",
    "refined-liver": "surrogate",
    "sampling": "surrogate",
    "seeds": "surrogate",
    "shapes": "surrogate",
    "side-by-side": "surrogate",
    "tools": "surrogate",
    "trained": "surrogate",
    "training": "surrogate",
    "whole-dataset": "surrogate",
}


def add_to(commands: Commands) -> None:
    """Add the parsers."""
    benchmark = add_command(
        commands,
        "benchmark",
        "measure a benchmark, write its record and its page",
        "python -m experiments benchmark large-bodies --sizes small",
        "python -m experiments benchmark equilibrium --help",
    )
    benchmark.add_argument("name", metavar="NAME", help=", ".join(PROGRAMS))
    benchmark.add_argument("words", nargs=argparse.REMAINDER, metavar="…", help="its options")
    benchmark.set_defaults(command=run)
    listing = add_command(commands, "list", "list all experiments", "python -m experiments list")
    listing.set_defaults(command=run_list)


def run(options: argparse.Namespace) -> None:
    """Measure in the environment of the benchmark's program, on one thread or OMP_NUM_THREADS."""
    name, words = options.name, options.words
    if name not in PROGRAMS:
        raise InputError(f"benchmark '{name}': expected one of {', '.join(PROGRAMS)}")
    python = ROOT / f".venv-{PROGRAMS[name]}" / "bin" / "python"
    elsewhere = python.is_file() and Path(sys.prefix).resolve() != python.parents[1].resolve()
    threads = os.environ.get("OMP_NUM_THREADS")
    if elsewhere or threads is None:
        program = str(python) if elsewhere else sys.executable
        arguments = [program, "-m", "experiments", "benchmark", name, *words]
        added = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": threads or "1"}
        os.execve(program, arguments, {**os.environ, **added})
    program = f"OMP_NUM_THREADS={threads} .venv-{PROGRAMS[name]}/bin/python"
    command = f"{program} -m experiments benchmark {name}"
    print(find_benchmark(name).run(words, command))


def find_benchmark(name: str) -> Benchmark:
    """Import a benchmark, in the environment of its program."""
    from experiments.benchmarks.benchmark import Benchmark

    return Benchmark.of(import_module(f"experiments.benchmarks.{name.replace('-', '_')}"))


def run_list(options: argparse.Namespace) -> None:
    """Print the names of all experiments and what they measure."""
    from experiments.catalogue import REPORTS
    from experiments.gpu.catalogue import STEPS

    for command, report in REPORTS.items():
        for study in report.studies:
            print(f"{command}\t{study.name}\t{study.title}")
    for name in PROGRAMS:
        source = ROOT / "experiments" / "benchmarks" / f"{name.replace('-', '_')}.py"
        what = ast.get_docstring(ast.parse(source.read_text())) or ""
        print(f"benchmark\t{name}\t{what.splitlines()[0]}")
    for step in STEPS:
        print(f"gpu\t{step.name}\t{step.title}")
