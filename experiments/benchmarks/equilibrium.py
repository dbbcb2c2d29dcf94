"""Time to find an equilibrium: the method of the FEniCSx tutorials and that of `datagen`.

The tutorials solve a hyperelastic problem by dolfinx's NewtonSolver with a direct solve of every
tangent (MUMPS). Both methods get the same mesh, forms, loads and tolerance (1e-8 N on the
residual), and are timed alternately in one process on one core, so that other work on the machine
slows both. A second pass over the same loads, with PETSc's log on, measures the parts of the time.

    python -m experiments benchmark equilibrium

writes its record and its page.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from datagen import Case, read_case
from datagen.cases import Body, make_body
from datagen.solver import solve_load_case
from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.tutorial import LoggedTutorialProblem, TutorialProblem, tutorial_solver
from experiments.framework.report import markdown_table, table_of
from shared_schema.common import Parser
from shared_schema.loads import LoadCase

STRIDE = 7919  # between sample numbers; a prime, so that the loads are all over the body
# PETSc's events, chosen so that no two overlap: dolfinx's solver factorises a new tangent within
# KSPSolve but before PCApply, SNES before KSPSolve.
FACTORISATION = ("MatLUFactorSym", "MatLUFactorNum")
TUTORIAL_EVENTS = {
    "tangent": (LoggedTutorialProblem.tangent_event,),
    "residual": (LoggedTutorialProblem.residual_event,),
    "set_up": FACTORISATION,
    "solves": ("PCApply",),
}
DATAGEN_EVENTS = {
    "tangent": ("SNESJacobianEval",),
    "residual": ("SNESFunctionEval",),
    "set_up": FACTORISATION,
    "solves": ("KSPSolve",),
}
PARTS = (*DATAGEN_EVENTS, "rest")
Events = dict[str, tuple[str, ...]]


def picked_loads(case: Case, body: Body, samples: int) -> Iterator[LoadCase]:
    """Yield the loads of the comparison, and one more at the start to warm up both methods."""
    for index in range(samples + 1):
        yield case.loads[0].draw(index * STRIDE, case.dataset.seed, body.loads.loadable)


def case_of(label: str) -> Case:
    """Case of a row: the name of a shipped one, and a linear solver instead of the case's."""
    name, _, linear_solver = label.partition(", ")
    case = read_case(name)
    if not linear_solver:
        return case
    solver = case.solver.model_copy(update={"linear_solver": linear_solver})
    return case.model_copy(update={"solver": solver})


def compare(name: str, samples: int) -> Results:
    """Time both methods in turn on the same loads; keep those that both solve without a cutback."""
    case = case_of(name)
    body = make_body(case, MPI.COMM_SELF)
    problem = TutorialProblem(case, body)
    solver = tutorial_solver(problem)
    times: list[tuple[float, float]] = []
    iterations: list[tuple[int, int]] = []
    kept: list[int] = []
    largest = 0.0
    for index, load in enumerate(picked_loads(case, body, samples)):
        problem.take(load)
        began = time.perf_counter()
        theirs, converged = solver.solve(problem.state)
        middle = time.perf_counter()
        report = solve_load_case(body.problem, load.nodes, load.forces, case.solver)
        ended = time.perf_counter()
        if index == 0 or not converged or report.cutbacks:
            continue
        kept.append(index)
        times.append((middle - began, ended - middle))
        iterations.append((theirs, report.newton_iterations))
        difference = np.abs(problem.state.x.array - body.problem.u.x.array).max()
        largest = max(largest, float(difference))
    tutorial, ours = np.array(times).T
    return {
        "case": name,
        "degrees_of_freedom": int(body.mesh.coordinates.size),
        "samples": len(times),
        "kept": kept,
        "tutorial_ms": round(float(np.median(tutorial)) * 1e3, 3),
        "datagen_ms": round(float(np.median(ours)) * 1e3, 3),
        "ratio_of_medians": round(float(np.median(tutorial) / np.median(ours)), 2),
        "ratio_of_sums": round(float(tutorial.sum() / ours.sum()), 2),
        "newton_iterations": [round(float(n), 2) for n in np.mean(iterations, axis=0)],
        "largest_difference_m": largest,
    }


def time_parts(name: str, samples: int, kept: list[int]) -> list[Results]:
    """Mean times of the parts of a load case by both methods, over the loads kept by `compare`.

    PETSc's log must be on. The rest is the whole less the parts that are logged.
    """
    case = case_of(name)
    body = make_body(case, MPI.COMM_SELF)
    problem = LoggedTutorialProblem(case, body)
    solver = tutorial_solver(problem)
    loads = list(picked_loads(case, body, samples))

    def tutorial(load: LoadCase) -> None:
        problem.take(load)
        solver.solve(problem.state)

    def ours(load: LoadCase) -> None:
        solve_load_case(body.problem, load.nodes, load.forces, case.solver)

    ways: list[tuple[str, Callable[[LoadCase], None], Events]] = [
        ("tutorial", tutorial, TUTORIAL_EVENTS),
        ("datagen", ours, DATAGEN_EVENTS),
    ]
    found = []
    for way, solve, events in ways:
        solve(loads[0])
        before = _logged(events)
        began = time.perf_counter()
        for index in kept:
            solve(loads[index])
        whole = 1e3 * (time.perf_counter() - began) / len(kept)
        parts = {p: 1e3 * (t - before[p]) / len(kept) for p, t in _logged(events).items()}
        parts["rest"] = whole - sum(parts.values())
        rounded = {part: round(ms, 4) for part, ms in parts.items()}
        found.append({"case": name, "way": way, "whole_ms": round(whole, 4), "parts_ms": rounded})
    return found


def _logged(events: Events) -> dict[str, float]:
    """Time in s that PETSc has logged so far for each part."""
    return {
        part: sum(PETSc.Log.Event(name).getPerfInfo()["time"] for name in names)
        for part, names in events.items()
    }


ABOUT = """\
dolfinx's NewtonSolver with MUMPS in every iteration, as in the FEniCSx tutorials, beside `datagen`:
same mesh, loads, forms and tolerance (1e-8 N on the residual), timed in turn in one process on one
core. Times are medians of a load case; cases in which the tutorial's solver fails or `datagen` cuts
back a load step are left out. Parts are shares of the mean time in a second pass with PETSc's log
on: assembly of *tangent* and *residual* (with `datagen`'s check for inverted elements), *set-up*
(factors of the tangents; `datagen` builds its multigrid hierarchy once, before the loads), *solves*
(triangular or Krylov) and the *rest* (Newton's method, Python, copies).
"""


def page(results: Results) -> str:
    """Make the page."""
    comparison = table_of(
        results["comparison"],
        {
            "case": "`{case}`",
            "DOFs": "{degrees_of_freedom}",
            "load cases": "{samples}",
            "tutorial [ms]": "{tutorial_ms:.3g}",
            "datagen [ms]": "{datagen_ms:.3g}",
            "ratio": "**{ratio_of_medians:.1f}**",
        },
    )
    parts = markdown_table(
        ("case", "method", "tangent", "residual", "set-up", "solves", "rest"),
        (
            (
                f"`{r['case']}`",
                r["way"],
                *(f"{r['parts_ms'][part] / r['whole_ms']:.0%}" for part in PARTS),
            )
            for r in results["parts"]
        ),
    )
    return f"{comparison}\n{parts}"


def measure(options: argparse.Namespace) -> Results:
    """Results of the comparison in two and three dimensions."""
    sizes = {
        "beam2d": options.samples_2d,
        "lshape2d": options.samples_2d,
        "beam3d": options.samples_3d,
        "beam3d, corotated": options.samples_3d,
    }
    comparison = [compare(name, samples) for name, samples in sizes.items()]
    PETSc.Log.begin()  # cannot be ended, so it begins after the comparison
    parts: list[Any] = []
    for one in comparison:
        parts += time_parts(one["case"], sizes[one["case"]], one.pop("kept"))
    return {"comparison": comparison, "parts": parts}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument(
        "--samples-2d", type=int, default=500, help="number of load cases of each 2D case"
    )
    parser.add_argument("--samples-3d", type=int, default=12, help="number of load cases of beam3d")
    parser.add_argument(
        "--platform",
        default="",
        metavar="NAME",
        help="write files of this name's own, such as debian-13 (those without are of Debian 12)",
    )


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return str(options.platform)


TITLE = "Time to find an equilibrium"
PART = "dolfinx {dolfinx}"
