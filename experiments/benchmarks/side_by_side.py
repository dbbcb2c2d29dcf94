"""The same bodies and loads in other programs: lines of code, times and errors.

    python -m experiments benchmark side-by-side --case beam3d_any --loads 6

writes its record, its page and a figure. Samples of the factory are the reference. Every other
program runs in an environment of its own in the folder `--work`, which pip fills.
"""

from __future__ import annotations

import argparse
import ast
import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import DOCS, Results
from experiments.benchmarks.others.measured import clock
from experiments.framework.environment import python_with
from experiments.framework.factory import FACTORY, factory
from experiments.framework.report import markdown_table
from shared_schema import MANIFEST, DatasetReader
from shared_schema.common import Parser, scatter_forces
from shared_schema.common.drawing import NETWORK, make_figure, save, styled
from surrogate.mechanics import Body, Load, Series

Array = NDArray[np.float64]
TITLE = "Side by side with other programs"
OTHERS = Path(__file__).parent / "others"
SPACE = ("beam3d_any", "liver3d")
ALL = ("beam2d_any", *SPACE, "finger3d")


@dataclass(frozen=True)
class Program:
    """Another program: name, what pip installs, its cases, most loads in space, what it lacks."""

    name: str
    packages: tuple[str, ...]
    cases: tuple[str, ...]
    loads: int
    lacks: str


PROGRAMS = {  # by its script; no packages: the factory's environment
    "by_dolfinx": Program(
        "dolfinx, tutorial", (), ALL, 2, "no estimate of the error; every load is solved anew"
    ),
    "by_felupe": Program(
        "FElupe",
        ("felupe==11.3.0", "tensortrax==0.29.0"),
        ALL,
        2,
        "no estimate of the error; every load is solved anew",
    ),
    "by_torch_fem": Program(
        "torch-fem",
        ("torch==2.13.0", "torch-fem==0.14.0"),
        ALL[:3],
        2,
        "no following pressure, no estimate of the error",
    ),
    "by_mfem": Program(
        "MFEM",
        ("mfem==4.10.0.1",),
        ALL[:3],
        2,
        "from Python its own two hyperelastic laws alone; no following pressure, no estimate of "
        "the error",
    ),
    "by_mujoco": Program(
        "MuJoCo",
        ("mujoco==4.0.0",),
        SPACE,
        2,
        "no equilibrium but a motion that comes to rest; tetrahedra of St. Venant and Kirchhoff's "
        "material alone, no plane strain, no following pressure, no estimate of the error",
    ),
    "by_newton": Program(
        "Newton",
        ("newton==1.8.0", "warp-lang==1.19.0"),
        SPACE,
        2,
        "no equilibrium but a motion, stopped after 10 s if it is not at rest; tetrahedra, single "
        "precision, no plane strain, no following pressure, no estimate of the error",
    ),
}
ABSENT = {
    "JAX-FEM 0.0.11": "imports petsc4py, which has no wheel: pip builds PETSc from its source, "
    "which did not end in 7 minutes",
    "SOFA": "no package of pip; no published times with errors of such equilibria were found",
}
OURS: dict[str, Callable[[Series, Load], Array]] = {  # in the order in which they are measured
    "`surrogate`, load series": lambda series, load: series.predict(load),
    "`surrogate`, `tolerance=5e-3`": lambda series, load: series.predict(load, tolerance=5e-3),
    "`surrogate`, `tolerance=1e-4`": lambda series, load: series.predict(load, tolerance=1e-4),
    "`surrogate`, load series and certificate": lambda series, load: certified(series, load),
    "`surrogate`, equilibrium": lambda series, load: corrected(series, load),
}
LINES_OF_OURS = 3


def certified(series: Series, load: Load) -> Array:
    """Prediction with an estimated error of every node."""
    u = series.predict(load)
    series.body.certify(load, u)
    return u


def corrected(series: Series, load: Load) -> Array:
    """Equilibrium that the directions reach from a prediction."""
    u = series.predict(load, tolerance=1e-4)
    return series.body.correct(load, u).displacement


@dataclass(frozen=True)
class Problem:
    """A body, loads and their displacements in m, (N, n_nodes, d), in a folder."""

    folder: Path
    body: Body
    loads: Load
    truth: Array

    @classmethod
    def read(cls, folder: Path) -> Problem:
        """Read all samples."""
        names = ("loaded_nodes", "force", "displacement")
        arrays = DatasetReader(folder).joined([f"samples/{name}" for name in names])
        nodes, force, truth = (arrays[f"samples/{name}"] for name in names)
        body = Body.read(folder)
        forces = scatter_forces(nodes, force, truth.shape[1])
        return cls(folder, body, Load.of_samples(body.geometry, forces), truth)

    def row(self, program: str, lines: int, found: Array, times: Array) -> dict[str, Any]:
        """What is published of the first displacements that a program finds."""
        truth = self.truth[: len(found)]
        error = np.linalg.norm(found - truth, axis=2).max(axis=1)
        error /= np.linalg.norm(truth, axis=2).max(axis=1)
        solved = np.isfinite(error)
        return {
            "nodes": truth.shape[1],
            "program": program,
            "lines": lines,
            "loads": len(found),
            "unsolved": int((~solved).sum()),
            "first_s": float(times[0]),
            "next_s": float(np.median(times[1:])),
            "error": float(error[solved].max(initial=0.0)),
        }


def measure(options: argparse.Namespace) -> Results:
    """Measure all programs on one body."""
    case, folder = options.case, options.work / options.case
    if not (folder / MANIFEST).is_file():
        factory("run", case, "--samples", options.loads, "--out", folder)
    problem, in_space = Problem.read(folder), case != ALL[0]
    for each in OURS.values():  # compiles
        each(Series(problem.body), problem.loads[0])
    rows = [problem.row(way, LINES_OF_OURS, *ours(problem, OURS[way])) for way in OURS]
    for script, program in PROGRAMS.items():
        if case in program.cases:
            found = other(script, problem, program.loads if in_space else None)
            rows.append(problem.row(program.name, lines_of(script), *found))
    results = {"case": case, "nodes": rows[0]["nodes"], "rows": rows}
    save(draw(results), DOCS / "figures" / f"side-by-side-{case}.png")
    return results


def ours(problem: Problem, way: Callable[[Series, Load], Array]) -> tuple[Array, Array]:
    """Displacements, and times, from the body alone."""
    found, times, began = [], [], clock()
    series = Series(Body.read(problem.folder))
    for number in range(len(problem.truth)):
        found.append(way(series, problem.loads[number]))
        times.append(clock() - began)
        began = clock()
    return np.array(found), np.array(times)


def other(script: str, problem: Problem, loads: int | None) -> tuple[Array, Array]:
    """The same of another program, in its environment."""
    folder, packages = problem.folder, PROGRAMS[script].packages
    environment = folder.parent / f"venv-{script}"
    python = python_with(environment, packages) if packages else FACTORY.parent / "python"
    geometry, material = problem.body.geometry, problem.body.case["material"]
    given, found = folder / "problem.npz", folder / f"{script}.npz"
    arrays = {
        "x": geometry.coordinates,
        "cells": geometry.cells,
        "type": geometry.cell_type,
        "held": ~geometry.free,
        "young": material["young_modulus"],
        "poisson": material["poisson_ratio"],
        "force": problem.loads.dead[:loads],
    }
    if problem.loads.following is not None:
        arrays["pressed"] = geometry.pressed
        arrays["pressure"] = problem.loads.following.amplitudes[:loads, 0]
    np.savez(given, **arrays)
    words = [path.absolute() for path in (python, OTHERS / f"{script}.py", given, found)]
    with TemporaryDirectory() as left:  # compiled code and logs
        alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "XDG_CACHE_HOME": left}
        subprocess.run(words, check=True, env=alone, cwd=left)
    with np.load(found) as solution:
        return solution["displacement"], solution["seconds"]


def lines_of(script: str) -> int:
    """Lines of a script that are its user's: of functions and classes, without a docstring each."""
    source = (OTHERS / f"{script}.py").read_text(encoding="utf-8")
    tree, count = ast.parse(source), 0
    for of in (node for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)):
        lines = source.splitlines()[of.lineno - 1 : of.end_lineno]
        count += sum(bool(line.strip()) for line in lines) - 1
    return count


@styled
def draw(results: Results) -> Figure:
    """Draw largest errors over the time of a further load."""
    figure, rows = make_figure(5.6, 3.6), results["rows"]
    axes = figure.subplots()
    mine = [row for row in rows if row["program"] in OURS]
    sure = [row for row in mine if "certificate" in row["program"]]
    line = [row for row in mine if row not in sure]
    axes.loglog(*points(line), "o-", color=NETWORK, label="surrogate: series to equilibrium")
    axes.loglog(*points(sure), "*", color=NETWORK, label="surrogate, certificate", markersize=10)
    for number, program in enumerate(PROGRAMS.values()):
        of_it = [row for row in rows if row["program"] == program.name]
        if of_it:
            axes.loglog(*points(of_it), "sD^vPX"[number], color=f"C{number}", label=program.name)
    axes.set_xlabel("time of a further load [s]")
    axes.set_ylabel("largest error / displacement")
    axes.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(loc="outside right center", fontsize=7)
    return figure


def points(rows: list[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Times and errors."""
    return [row["next_s"] for row in rows], [row["error"] for row in rows]


def page(results: Results) -> str:
    """Make the part of one body."""
    columns = "program", "lines", "loads", "first answer [s]", "every other [s]", "largest error"
    cells = [
        (
            row["program"],
            str(row["lines"]),
            str(row["loads"]) + (f", {row['unsolved']} not solved" if row["unsolved"] else ""),
            f"{row['first_s']:.2g}",
            f"{row['next_s']:.2g}",
            f"{row['error']:.1e}",
        )
        for row in results["rows"]
    ]
    picture = f"../figures/side-by-side-{results['case']}.png"
    title = f"## `{results['case']}`, {results['nodes']} nodes"
    table = markdown_table(columns, cells)
    return f"{title}\n\n![Error over the time of a further load]({picture})\n\n{table}"


def variant(options: argparse.Namespace) -> str:
    """Return the name of the case."""
    return str(options.case)


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--case", default=ALL[0], choices=ALL)
    parser.add_argument("--loads", type=int, default=20)
    parser.add_argument("--work", type=Path, default=Path("build/side-by-side"))


def lacking() -> str:
    """Make the table of what programs cannot do."""
    rows = [(program.name, program.lacks) for program in PROGRAMS.values()]
    rows += [(name, f"not measured: {why}") for name, why in ABSENT.items()]
    return markdown_table(("program", "what it cannot do here"), rows)


ABOUT = f"""\
The same meshes, moduli and loads in programs that solve or predict large deformations, on one \
core, one load after the other. Times are processor time, with that of compilers that are called: \
other work on the machine counts little. The error is that of the worst node over the largest \
displacement of its load, the largest of all loads, beside `datagen run`. Lines are those of code \
for body, material and solve, without reading the mesh. The first answer has reading, compiling \
and factors in it; the others are the median of what follows. The loops of `surrogate` were \
compiled before, once a machine; the others compile in their first answer. `surrogate` is here \
without a network, from the body alone. Scripts follow the tutorials of each program, \
with nodal forces and, under pressure, mean dilation added, five load steps where it has steps, \
and its usual linear solver. Lines of `surrogate` are beside its case, a file.

{lacking()}"""
