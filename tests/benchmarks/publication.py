"""What every benchmark publishes: its results as JSON, and the page that is made from them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from shared_schema.common.atomic_file import write_text
from shared_schema.common.processor import processor

DOCS = Path(__file__).parents[2] / "docs"
Results = dict[str, Any]


def result_path(name: str) -> Path:
    """Where the JSON of a benchmark lies."""
    return DOCS / "results" / f"benchmark-{name}.json"


def page_path(name: str) -> Path:
    """Where its page lies."""
    return DOCS / f"benchmark-{name}.md"


def publish(name: str, results: Results, table: Callable[[Results], str]) -> None:
    """Print the results, and write them and the page that `table` makes of them."""
    results["machine"]["load_averages"].append(_load_average())
    text = json.dumps(results, indent=1)
    print(text)
    write_text(result_path(name), text + "\n")
    write_text(page_path(name), table(results))


def command(module: str, options: Sequence[str], environment: str = ".venv-datagen") -> str:
    """How the benchmark is run again, from the root of the repository."""
    words = [f"OMP_NUM_THREADS=1 {environment}/bin/python -m", f"tests.benchmarks.{module}"]
    return " ".join([*words, *options])


def machine(software: Callable[[], Results] | None = None) -> Results:
    """Describe the machine and the software that is timed; called before anything is.

    `software` gives the versions; those of the solver if left out.
    """
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "load_averages": [_load_average()],
        **(software or _solver)(),
    }


def _solver() -> Results:
    """Versions of what finite elements are solved with."""
    import dolfinx
    from mpi4py import MPI
    from petsc4py import PETSc

    mpi, version = MPI.get_vendor()
    return {
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
        "mpi": f"{mpi} {'.'.join(str(part) for part in version)}",
    }


def _load_average() -> float:
    """Processes that ran in the last minute."""
    return round(os.getloadavg()[0], 2)


def footer(results: Results) -> str:
    """Machine and command, to end a page with."""
    m = results["machine"]
    before, after = m["load_averages"]
    software = (
        f"PyTorch {m['torch']}"
        if "torch" in m
        else f"dolfinx {m['dolfinx']}, PETSc {m['petsc']}, {m['mpi']}"
    )
    return (
        f"{m['processor']}, {m['cores']} cores, load average {before:.1f} before and {after:.1f} "
        f"after;\n{software}. Made by\n\n"
        f"```\n{results['command']}\n```\n"
    )


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
