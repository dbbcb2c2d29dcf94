"""Corrected predictions against `datagen`'s solutions, and solutions from predicted starts.

`surrogate` draws random loads of a network's training, predicts them and corrects the predictions
(`experiments.benchmarks.corrected_loads`). `datagen` solves the same loads from rest and from the
prediction, in turn in one process. All times are processor times of one thread.

    python -m experiments benchmark corrections CASE RUN

writes its record and its page. Everything is kept in the folder
`--work` for a later start to resume; `--only-solved` publishes what is there.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen import Case, read_case
from datagen.cases import Body, make_body
from datagen.solver import solve_from, solve_load_case
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from shared_schema.common import Parser, complete_or_absent

Array = NDArray[np.float64]
LEARNER = Path(".venv-surrogate/bin/python")
ROOT = Path(__file__).parents[2]


def measure(options: argparse.Namespace) -> Results:
    """Correct and solve all load cases, and compare."""
    folder = options.work / options.case
    if not options.only_solved:
        words = [
            LEARNER,
            "-m",
            "experiments.benchmarks.corrected_loads",
            options.run,
            options.count,
        ]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        subprocess.run([*map(str, words), str(folder)], check=True, env=environment)
    case = read_case(options.case)
    body = make_body(case, MPI.COMM_SELF)
    found = []
    for number in range(options.count):
        path, solved = folder / f"load-{number:05d}.npz", folder / f"solved-{number:05d}.npz"
        if options.only_solved and not solved.is_file():
            continue
        if not solved.is_file():
            solve(path, solved, body, case)
        with np.load(path) as corrected, np.load(solved) as solution:
            found.append(compared(corrected, solution))
    return {"case": options.case, **summary(found)}


def solve(path: Path, out: Path, body: Body, case: Case) -> None:
    """Solve a load case from rest and from the prediction."""
    with np.load(path) as file:
        force, predicted = file["force"], file["displacement"]
    nodes = np.flatnonzero(force.any(axis=1))
    arguments = body.problem, nodes, force[nodes], case.solver
    from_rest, rested = timed(lambda: solve_load_case(*arguments), time.process_time)
    at_rest = body.problem.displacement()
    started, seconds = timed(lambda: solve_from(predicted, *arguments), time.process_time)
    from_start, used = started
    with complete_or_absent(out) as partial, partial.open("wb") as file:
        np.savez_compressed(
            file,
            from_rest=at_rest,
            from_start=body.problem.displacement(),
            solved=np.array([from_rest.solved, from_start.solved]),
            used=used,
            seconds=np.array([rested, seconds]),
            iterations=np.array([from_rest.newton_iterations, from_start.newton_iterations]),
        )


def compared(corrected: dict[str, Array], solution: dict[str, Array]) -> dict[str, float]:
    """Compare the results of one load case."""
    reference = solution["from_rest"]
    return {
        "lost": float(int(corrected["iterations"]) < 0 or not solution["solved"].all()),
        "before": float(np.abs(corrected["displacement"] - reference).max()),
        "correct_difference": float(np.abs(corrected["corrected"] - reference).max()),
        "start_difference": float(np.abs(solution["from_start"] - reference).max()),
        "correct_iterations": float(corrected["iterations"]),
        "correct_seconds": float(corrected["seconds"]),
        "used": float(solution["used"]),
        "rest_seconds": float(solution["seconds"][0]),
        "start_seconds": float(solution["seconds"][1]),
        "rest_iterations": float(solution["iterations"][0]),
        "start_iterations": float(solution["iterations"][1]),
    }


def summary(found: list[dict[str, float]]) -> Results:
    """Summarise all load cases."""
    columns = {name: np.array([one[name] for one in found]) for name in found[0]}
    ratio = columns["rest_seconds"] / columns["start_seconds"]
    return {
        "load_cases": len(found),
        "lost": int(columns["lost"].sum()),
        "largest_error_of_a_prediction": float(columns["before"].max()),
        "largest_difference_of_correct": float(columns["correct_difference"].max()),
        "median_difference_of_correct": float(np.median(columns["correct_difference"])),
        "largest_difference_of_start": float(columns["start_difference"].max()),
        "mean_iterations": {
            name: float(columns[f"{name}_iterations"].mean())
            for name in ("correct", "rest", "start")
        },
        "median_milliseconds": {
            name: 1e3 * float(np.median(columns[f"{name}_seconds"]))
            for name in ("correct", "rest", "start")
        },
        "starts_used": float(columns["used"].mean()),
        "median_ratio_of_times": float(np.median(ratio)),
        "ratio_of_median_times": float(
            np.median(columns["rest_seconds"]) / np.median(columns["start_seconds"])
        ),
    }


def page(results: Results) -> str:
    """Make the page."""
    iterations, times = results["mean_iterations"], results["median_milliseconds"]
    ways = {
        "`datagen solve`, from rest": "rest",
        "`datagen solve --start`, from the prediction": "start",
        "`surrogate predict --correct`": "correct",
    }
    rows = [(what, f"{iterations[key]:.2f}", f"{times[key]:.3g}") for what, key in ways.items()]
    return (
        f"{results['load_cases']} loads, {results['lost']} lost. The largest error of a component "
        f"is {results['largest_error_of_a_prediction']:.2g} m before, "
        f"{results['largest_difference_of_correct']:.2g} m after the correction by `surrogate`, "
        f"and {results['largest_difference_of_start']:.2g} m after that by `datagen`. From rest "
        f"`datagen` takes {results['ratio_of_median_times']:.2f} times as long as from the "
        f"prediction.\n\n{markdown_table(['way', 'Newton iterations', 'ms'], rows)}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("case")
    parser.add_argument("run", help="run folder, or a network of the package")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--work", type=Path, default=Path("runs/corrections"))
    parser.add_argument("--only-solved", action="store_true")


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return str(options.case)


TITLE = "Corrected predictions"
ABOUT = (
    "Random loads like those of the training, all solved. Times are processor times of one "
    "thread, medians; Newton iterations are means."
)
PART = "`{case}`"
