"""Certificates and corrections on a large body: tangents factorised, and solved with by iterations.

    python -m experiments benchmark tangents --folder build/refined-liver-1

writes its record and its page. The body and its load series are made in the folder, unless they are
there. Factors are by PARDISO where it is installed, and by SuperLU elsewhere.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Benchmark, Results
from experiments.benchmarks.refined_liver import CASE, Steps
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser
from surrogate import load
from surrogate.certify import certify, correct
from surrogate.descent import DrivenBody
from surrogate.mechanics import Equilibrium

Array = NDArray[np.float64]
LOAD = (300.0, -200.0, 500.0)  # body force in N/m³
WORK = {
    "certificate": "full certificate of the series' prediction",
    "correction": "correction of it",
    "from_rest": "the same equilibrium, from rest",
}


def measure(options: argparse.Namespace) -> Results:
    """Time both ways in turn."""
    steps = Steps(options.folder, options.refine)
    if not (options.folder / "series").exists():
        steps.make_series()
    model = load(options.folder / "series")
    factorised = model.equilibrium
    first = timed(lambda: factorised.undeformed)[1]
    iterated = factorised.iterating(DrivenBody.of(factorised).compliance.at)
    found = model.solve(body_force=LOAD)
    force, predicted = np.asarray(found.force), np.asarray(found.displacement)
    works: dict[str, Callable[[Equilibrium], Array]] = {
        "certificate": lambda body: certify(body, force, predicted).error,
        "correction": lambda body: correct(body, force, predicted).displacement,
        "from_rest": lambda body: correct(body, force, 0 * predicted).displacement,
    }
    results: Results = {
        "nodes": len(predicted),
        "factor": getattr(factorised.undeformed, "title", "band"),
        "undeformed_s": round(first, 1),
        "repeats": options.repeats,
    }
    for name, work in works.items():
        results[name] = both(work, factorised, iterated, options.repeats)
        print(name, results[name], file=sys.stderr)
    return results


def both(
    work: Callable[[Equilibrium], Array], factorised: Equilibrium, iterated: Equilibrium, count: int
) -> Results:
    """Medians in s of both ways, in turn, and how far their results are apart."""
    taken = np.empty((count, 2))
    for repeat in range(count):
        one, taken[repeat, 0] = timed(partial(work, factorised))
        other, taken[repeat, 1] = timed(partial(work, iterated))
    factors, iterations = np.median(taken, axis=0)
    return {
        "factors_s": round(float(factors), 1),
        "iterations_s": round(float(iterations), 1),
        "ratio": round(float(np.median(taken[:, 0] / taken[:, 1])), 2),
        "difference": float(f"{np.abs(other - one).max() / np.abs(one).max():.1e}"),
    }


def page(results: Results) -> str:
    """Make the page."""
    rows = [
        (
            title,
            f"{found['factors_s']:.1f} s",
            f"{found['iterations_s']:.1f} s",
            f"{found['ratio']:.2f}",
            f"{found['difference']:.1e}",
        )
        for name, title in WORK.items()
        for found in [results[name]]
    ]
    head = ("work", "factors of K(u)", "iterations", "ratio", "difference of results")
    return (
        f"{results['factor']} factorises K(0) in {results['undeformed_s']:.1f} s. Medians of "
        f"{results['repeats']}.\n\n{markdown_table(head, rows)}"
    )


def add_arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--refine", type=int, default=1, help="divisions of each cell (default 1)")
    parser.add_argument("--repeats", type=int, default=3, help="of every work (default 3)")
    parser.add_argument("--folder", type=Path, default=Path("build/refined-liver-1"))


BENCHMARK = Benchmark(
    name="tangents",
    title="Tangents of a large body: factors or iterations",
    measure=measure,
    page=page,
    arguments=add_arguments,
    variant=lambda _: "superlu" if find_spec("pypardiso") is None else "pardiso",
    about=(
        f"`{CASE}` with {{nodes}} nodes under a body force of "
        f"{', '.join(f'{value:g}' for value in LOAD)} N/m³. Factors of K(0) are kept. Iterations "
        "are conjugate gradients with the compliance of the undeformed body, carried to the state. "
        "Both ways are timed in turn."
    ),
    part="{factor}",
)
