"""The same bodies and loads in other programs: lines of code, times and errors.

    python -m experiments benchmark side-by-side

writes its record and its page. Samples of the factory are the reference. Every other program runs
in an environment of its own in the folder `--work`, which pip fills.
"""

from __future__ import annotations

import argparse
import ast
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Results
from experiments.framework.environment import python_with
from experiments.framework.factory import factory
from experiments.framework.report import markdown_table
from shared_schema import MANIFEST, DatasetReader
from shared_schema.common import Parser, scatter_forces
from surrogate.mechanics import Body, Load, Series
from surrogate.mechanics.descent.aim import Aim

Array = NDArray[np.float64]
TITLE = "Side by side with other programs"
ABOUT = (
    "The same meshes, materials and loads in programs that solve or predict large deformations of "
    "Neo-Hookean bodies, on one core, one load after the other, {loads} loads each. The error is "
    "that of the worst node over the largest displacement of its load, the largest of all loads, "
    "beside `datagen run`. Lines are those of code for body, material and solve, without reading "
    "the mesh. The first answer has reading, compiling and factors in it; the others are the "
    "median of what follows. `surrogate` is here without a network, from the body alone."
)
OTHERS = Path(__file__).parent / "others"
PROGRAMS = {  # by its script: name, and what pip installs
    "by_felupe": ("FElupe", ("felupe==11.3.0", "tensortrax")),
    "by_torch_fem": ("torch-fem", ("torch==2.13.0", "torch-fem==0.14.0")),
}
OURS = {  # lines, and the tolerance of a prediction; None: the series alone
    "`surrogate`, load series": (3, None),
    "`surrogate`, `tolerance=5e-3`": (3, 5e-3),
    "`surrogate`, `tolerance=1e-4`": (3, 1e-4),
}


def measure(options: argparse.Namespace) -> Results:
    """Measure all programs on all bodies."""
    rows = [
        row
        for case in options.cases.split(",")
        for row in measured(case, options.work, options.loads)
    ]
    return {"loads": options.loads, "rows": rows}


def measured(case: str, work: Path, loads: int) -> list[dict[str, Any]]:
    """Measure all programs on one body."""
    folder = work / case
    if not (folder / MANIFEST).is_file():
        factory("run", case, "--samples", loads, "--out", folder)
    body, forces, truth = problem_of(folder)
    size = np.linalg.norm(truth, axis=2).max(axis=1)

    def row(program: str, lines: int, found: Array, times: Array) -> dict[str, Any]:
        error = np.linalg.norm(found - truth, axis=2).max(axis=1) / size
        return {
            "case": case,
            "nodes": truth.shape[1],
            "program": program,
            "lines": lines,
            "first_s": float(times[0]),
            "next_s": float(np.median(times[1:])),
            "error": float(error.max()),
        }

    rows: list[dict[str, Any]] = []
    rows += [row(name, lines, *ours(folder, forces, aim)) for name, (lines, aim) in OURS.items()]
    rows += [row(PROGRAMS[s][0], lines_of(s), *other(s, folder, body, forces)) for s in PROGRAMS]
    return rows


def problem_of(folder: Path) -> tuple[Body, Array, Array]:
    """A body, forces in N and displacements in m of all samples, (N, n_nodes, d)."""
    names = ("loaded_nodes", "force", "displacement")
    arrays = DatasetReader(folder).joined([f"samples/{name}" for name in names])
    nodes, force, truth = (arrays[f"samples/{name}"] for name in names)
    return Body.read(folder), scatter_forces(nodes, force, truth.shape[1]), truth


def ours(folder: Path, forces: Array, aim: float | None) -> tuple[Array, Array]:
    """Displacements, and times, from the body alone."""
    found, times, began = [], [], time.perf_counter()
    model = Series(Body.read(folder))
    for force in forces:
        load = Load(force)
        u, _ = model.respond(load)
        if aim is not None:
            u, _ = model.body.descend(load, u, Aim(aim))
        found.append(u)
        times.append(time.perf_counter() - began)
        began = time.perf_counter()
    return np.array(found), np.array(times)


def other(script: str, folder: Path, body: Body, forces: Array) -> tuple[Array, Array]:
    """The same of another program, in its environment."""
    _, packages = PROGRAMS[script]
    python = python_with(folder.parent / f"venv-{script}", packages)
    geometry, material = body.geometry, body.case["material"]
    given, found = folder / "problem.npz", folder / f"{script}.npz"
    np.savez(
        given,
        x=geometry.coordinates,
        cells=geometry.cells,
        type=geometry.cell_type,
        held=~geometry.free,
        young=material["young_modulus"],
        poisson=material["poisson_ratio"],
        force=forces,
    )
    subprocess.run([str(python), str(OTHERS / f"{script}.py"), str(given), str(found)], check=True)
    with np.load(found) as solution:
        return solution["displacement"], solution["seconds"]


def lines_of(script: str) -> int:
    """Lines of code of a script that are its user's: those of its functions, without docstrings."""
    source = (OTHERS / f"{script}.py").read_text(encoding="utf-8")
    tree, count = ast.parse(source), 0
    for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
        lines = source.splitlines()[function.lineno - 1 : function.end_lineno]
        count += sum(bool(line.strip()) for line in lines) - 1
    return count


def page(results: Results) -> str:
    """Make the page."""
    blocks = []
    for case in dict.fromkeys(row["case"] for row in results["rows"]):
        rows = [row for row in results["rows"] if row["case"] == case]
        table = markdown_table(
            ("program", "lines", "first answer [s]", "every other [s]", "largest error"),
            (
                (
                    row["program"],
                    str(row["lines"]),
                    f"{row['first_s']:.2g}",
                    f"{row['next_s']:.2g}",
                    f"{row['error']:.1e}",
                )
                for row in rows
            ),
        )
        blocks.append(f"## `{case}`, {rows[0]['nodes']} nodes\n\n{table}")
    return "\n\n".join(blocks)


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--cases", default="beam2d_any,beam3d_any,liver3d")
    parser.add_argument("--loads", type=int, default=20)
    parser.add_argument("--work", type=Path, default=Path("build/side-by-side"))
