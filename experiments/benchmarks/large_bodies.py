"""Time and memory of a solve of large bodies, by linear solver and number of ranks.

A beam of 4 x 1 x 1 m is held at one end and bent by nodal forces at the other, which moves by
0.75 m. Every way is a process of its own (`mpirun` for two ranks); the tolerance is the default.

    python -m experiments benchmark large-bodies

writes its record and its page.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time

import numpy as np
from mpi4py import MPI

from datagen.mesh import distributed
from datagen.solver import EquilibriumProblem, SolverSettings, solve_load_case
from experiments.benchmarks.benchmark import Results
from experiments.framework.report import table_of
from shared_schema import NeoHookean
from shared_schema.common import Parser, WorkError, largest_resident
from tests.datagen.solver.cantilever import box
from tools.open_mpi import SETTINGS

SIZES = {"small": (27, 11, 11), "medium": (50, 19, 19), "large": (87, 33, 33)}
WAYS = (  # size, simplices, element, linear solver, ranks
    ("small", False, "linear", "lu", 1),
    ("small", False, "linear", "multigrid", 1),
    ("small", False, "linear", "auto", 1),
    ("small", False, "incompressible", "auto", 1),
    ("medium", False, "linear", "multigrid", 1),
    ("medium", False, "linear", "auto", 1),
    ("medium", False, "linear", "auto", 2),
    ("medium", True, "linear", "auto", 1),
    ("large", False, "linear", "auto", 1),
    ("large", False, "linear", "auto", 2),
)


def solve_once(way: Results) -> Results | None:
    """Build the body and solve it once, on all ranks; the result is that of rank 0."""
    comm = MPI.COMM_WORLD
    mesh = distributed(box((4.0, 1.0, 1.0), SIZES[way["size"]], way["simplices"]), comm)
    x = mesh.coordinates
    settings = SolverSettings(linear_solver=way["linear_solver"])
    material = NeoHookean(young_modulus=500, poisson_ratio=0.4)
    began = time.perf_counter()
    held = np.isclose(x[:, 0], 0.0)
    problem = EquilibriumProblem(mesh, material, held, settings, way["element"])
    built, at_work = time.perf_counter(), time.process_time()
    end = np.flatnonzero(np.isclose(x[:, 0], 4.0))
    forces = np.zeros((len(end), 3))
    forces[:, 2] = -1.5 / len(end)
    report = solve_load_case(problem, end, forces, settings)
    ended, worked = time.perf_counter(), time.process_time() - at_work
    memory = comm.allreduce(largest_resident())
    moved = float(-problem.displacement()[end, 2].mean())
    if comm.rank:
        return None
    return {
        **way,
        "nodes": len(x),
        "solver": problem.linear_solver,
        "set_up_s": round(built - began, 2),
        "solve_s": round(ended - built, 2),
        "processor_s": round(worked, 2),
        "memory_mb": round(memory / 1e6),
        "newton_iterations": report.newton_iterations,
        "cutbacks": report.cutbacks,
        "solved": report.solved,
        "moved_m": round(moved, 5),
    }


def in_own_process(way: Results) -> Results:
    """Run `solve_once` in new processes."""
    program = [
        sys.executable,
        "-m",
        "experiments.benchmarks.large_bodies",
        json.dumps(way),
    ]
    words = program if way["ranks"] == 1 else ["mpirun", "-n", str(way["ranks"]), *program]
    done = subprocess.run(
        words, env=os.environ | SETTINGS, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise WorkError(f"{' '.join(words)}\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["ways"],
        {
            "nodes": "{nodes}",
            "cells": lambda r: "tetrahedra" if r["simplices"] else "hexahedra",
            "`element`": "{element}",
            "linear solver": lambda r: (
                r["solver"] if r["linear_solver"] == r["solver"] else f"auto: {r['solver']}"
            ),
            "ranks": "{ranks}",
            "set-up": "{set_up_s:.1f} s",
            "solve": "**{solve_s:.1f} s**",
            "processor": "{processor_s:.1f} s",
            "memory": "{memory_mb} MB",
        },
    )
    return (
        "A beam of 4 x 1 x 1 m, bent until its end has moved by 0.75 m, to a residual of 1e-9 of "
        "the load. The set-up is done once\nfor a body: forms, matrix, and the hierarchy or the "
        "factors of the undeformed body. *Processor* is the time that rank 0\nworked on the solve, "
        "which other work on the machine changes little. Memory is that of all ranks.\n\n"
        f"{rows}"
    )


def measure(options: argparse.Namespace) -> Results:
    """Results of all ways."""
    names = ("size", "simplices", "element", "linear_solver", "ranks")
    ways = [dict(zip(names, way, strict=True)) for way in WAYS if way[0] in options.sizes]
    return {"ways": [in_own_process(way) for way in ways]}


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument(
        "--sizes", nargs="+", default=list(SIZES), choices=SIZES, help="sizes to measure"
    )


TITLE = "Time and memory of large bodies"

if __name__ == "__main__":
    if (found := solve_once(json.loads(sys.argv[1]))) is not None:
        print(json.dumps(found))
