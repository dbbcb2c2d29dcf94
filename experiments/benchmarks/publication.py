"""Running a benchmark and publishing it: results as JSON, and the page made from them."""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from shared_schema.common.atomic_file import write_text
from shared_schema.common.processor import processor

DOCS = Path(__file__).parents[2] / "docs"
Results = dict[str, Any]
Program = Literal["datagen", "surrogate"]


def result_path(name: str) -> Path:
    """Path of the JSON file of a benchmark."""
    return DOCS / "results" / f"benchmark-{name}.json"


def page_path(name: str) -> Path:
    """Path of the page of a benchmark."""
    return DOCS / f"benchmark-{name}.md"


def argument_parser(description: str | None) -> argparse.ArgumentParser:
    """Parser of a benchmark's options, described by the first line of its module."""
    return argparse.ArgumentParser(description=(description or "").partition("\n")[0])


def run_benchmark(
    name: str,
    module: str,
    parser: argparse.ArgumentParser,
    measure: Callable[[argparse.Namespace], Results],
    table: Callable[[Results], str],
    program: Program = "datagen",
) -> None:
    """Run a benchmark, print its results, and write them with their page.

    Parameters
    ----------
    name : str
        Name of the benchmark, in the names of both files.
    module : str
        Name of its module in `experiments.benchmarks`.
    parser : argparse.ArgumentParser
    measure : callable
        Measures, and returns the results, from the parsed options.
    table : callable
        Makes the page from the results.
    program : {"datagen", "surrogate"}
        The measured program, in whose environment the benchmark runs.
    """
    options = parser.parse_args()
    logging.disable(logging.INFO)
    described = machine(SOFTWARE[program])  # before anything is timed, for the load average
    results: Results = {
        "command": _command(module, sys.argv[1:], program),
        "machine": described,
        **measure(options),
    }
    described["load_averages"].append(_load_average())
    text = json.dumps(results, indent=1)
    print(text)
    write_text(result_path(name), text + "\n")
    write_text(page_path(name), table(results))


def _command(module: str, options: Sequence[str], program: Program) -> str:
    """Command that runs the benchmark again, from the root of the repository."""
    words = [f"OMP_NUM_THREADS=1 .venv-{program}/bin/python -m", f"experiments.benchmarks.{module}"]
    return " ".join([*words, *options])


def machine(software: Callable[[], Results]) -> Results:
    """Describe the machine and the measured software, whose versions `software` returns."""
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load_averages": [_load_average()],
        **software(),
    }


def _solver() -> Results:
    """Versions of the finite-element software."""
    import dolfinx
    from mpi4py import MPI
    from petsc4py import PETSc

    mpi, version = MPI.get_vendor()
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
        "mpi": f"{mpi} {'.'.join(str(part) for part in version)}",
    }


def _learner() -> Results:
    """Version of PyTorch."""
    import torch

    return {"torch": torch.__version__}


SOFTWARE: dict[Program, Callable[[], Results]] = {"datagen": _solver, "surrogate": _learner}


def _load_average() -> float:
    """Mean number of running processes over the last minute."""
    return round(os.getloadavg()[0], 2)


def footer(results: Results) -> str:
    """Last lines of a page: machine, software and command."""
    m = results["machine"]
    before, after = m["load_averages"]
    software = (
        f"PyTorch {m['torch']}"
        if "torch" in m
        else f"dolfinx {m['dolfinx']}, PETSc {m['petsc']}, {m['mpi']}"
    )
    return (
        f"{m['processor']}, {m['cores']} cores, load average {before:.1f} before and {after:.1f} "
        f"after;\n{software}. Made by\n\n<!-- not run: takes minutes -->\n"
        f"```sh\n{results['command']}\n```\n"
    )


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
