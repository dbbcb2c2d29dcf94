"""How fast an equilibrium is found: the way of the FEniCSx tutorials against `datagen`'s.

The tutorials solve a hyperelastic problem by dolfinx's NewtonSolver with a direct solve of every
tangent (MUMPS). Both ways get the same mesh, forms, loads and tolerance (1e-8 N on the residual),
and are timed in turn in one process on one core, so that a busy machine hits both. Run by

    OMP_NUM_THREADS=1 .venv-datagen/bin/python tests/benchmarks/equilibrium.py

which writes `docs/results/benchmark-equilibrium.json`.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import platform
import time
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from dolfinx.nls.petsc import NewtonSolver
from mpi4py import MPI
from petsc4py import PETSc

from datagen.body import Body, make_body
from datagen.case import Case, read_case
from datagen.load_stepping import solve_load_case
from datagen.loads import LoadCase
from datagen.material import deformation_gradient, strain_energy
from shared_schema.atomic_file import write_text

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "docs" / "results" / "benchmark-equilibrium.json"
TABLE = ROOT / "docs" / "benchmark-equilibrium.md"
STRIDE = 7919  # a prime, to pick loads all over the body


class TutorialProblem(fem_petsc.NonlinearProblem):
    """dolfinx's own nonlinear problem, with a nodal force taken from its residual."""

    def __init__(self, case: Case, body: Body) -> None:
        domain = body.mesh.domain
        space = dolfinx.fem.VectorFunctionSpace(domain, ("Lagrange", 1))
        self.state = dolfinx.fem.Function(space)
        lam = dolfinx.fem.Constant(domain, PETSc.ScalarType(case.material.lame_lambda))
        mu = dolfinx.fem.Constant(domain, PETSc.ScalarType(case.material.lame_mu))
        dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
        gradient = deformation_gradient(self.state)
        energy = strain_energy(gradient, lam, mu, case.material.volumetric) * dx
        residual = ufl.derivative(energy, self.state)
        self._numbering = body.problem.numbering
        clamped = np.flatnonzero(body.clamped[self._numbering.node_of_block]).astype(np.int32)
        zero = np.zeros(case.mesh.dimension, dtype=PETSc.ScalarType)
        super().__init__(residual, self.state, [dolfinx.fem.dirichletbc(zero, clamped, space)])
        self.load: tuple[Any, Any] = (np.empty(0, dtype=int), np.empty(0))

    def F(self, x: Any, b: Any) -> None:  # noqa: N802, dolfinx's name
        """Assemble the residual and subtract the nodal force."""
        super().F(x, b)
        dofs, values = self.load
        b.array_w[dofs] -= values

    def take(self, load: LoadCase) -> None:
        """Replace the nodal force, and go back to rest."""
        positions, blocks = self._numbering.owned_blocks(load.nodes)
        d = load.forces.shape[1]
        dofs = (blocks[:, None] * d + np.arange(d)).ravel()
        self.load = dofs, load.forces[positions].ravel()
        self.state.x.array[:] = 0.0


def tutorial_solver(problem: TutorialProblem) -> NewtonSolver:
    """dolfinx's NewtonSolver on the residual's norm, with MUMPS."""
    solver = NewtonSolver(MPI.COMM_SELF, problem)
    solver.convergence_criterion = "residual"
    solver.atol, solver.rtol, solver.max_it = 1e-8, 1e-30, 15
    solver.error_on_nonconvergence = False
    ksp = solver.krylov_solver
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    return solver


def processor() -> str:
    """Name of the processor."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def compare(name: str, samples: int) -> dict[str, Any]:
    """Time both ways on the same loads, one after the other, those that both solve in one step."""
    case = read_case(name)
    body = make_body(case, MPI.COMM_SELF)
    problem = TutorialProblem(case, body)
    solver = tutorial_solver(problem)
    times: list[tuple[float, float]] = []
    iterations: list[tuple[int, int]] = []
    largest = 0.0
    for index in range(-1, samples):  # the first warms both up
        load = case.load.draw((index + 1) * STRIDE, case.dataset.seed, body.loadable_nodes)
        problem.take(load)
        began = time.perf_counter()
        theirs, converged = solver.solve(problem.state)
        middle = time.perf_counter()
        report = solve_load_case(body.problem, load.nodes, load.forces, case.solver)
        ended = time.perf_counter()
        if index < 0 or not converged or report.cutbacks:
            continue
        times.append((middle - began, ended - middle))
        iterations.append((theirs, report.newton_iterations))
        difference = np.abs(problem.state.x.array - body.problem.u.x.array).max()
        largest = max(largest, float(difference))
    tutorial, ours = np.array(times).T
    return {
        "case": name,
        "degrees_of_freedom": int(body.mesh.coordinates.size),
        "samples": len(times),
        "tutorial_ms": round(float(np.median(tutorial)) * 1e3, 3),
        "datagen_ms": round(float(np.median(ours)) * 1e3, 3),
        "ratio_of_medians": round(float(np.median(tutorial) / np.median(ours)), 2),
        "ratio_of_sums": round(float(tutorial.sum() / ours.sum()), 2),
        "newton_iterations": [round(float(n), 2) for n in np.mean(iterations, axis=0)],
        "largest_difference_m": largest,
        "machine": f"{processor()}, {os.cpu_count()} cores, one used",
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(str(part) for part in PETSc.Sys.getVersion()),
    }


def table(results: list[dict[str, Any]]) -> str:
    """The results as a page."""
    rows = "".join(
        f"| `{r['case']}` | {r['degrees_of_freedom']} | {r['samples']} | {r['tutorial_ms']:.3g} | "
        f"{r['datagen_ms']:.3g} | **{r['ratio_of_medians']:.1f}** | {r['ratio_of_sums']:.1f} |\n"
        for r in results
    )
    return (
        "# How fast an equilibrium is found\n\n"
        "dolfinx's NewtonSolver with MUMPS at every iteration, as in the FEniCSx tutorials, "
        "against `datagen`:\nsame mesh, loads, forms and tolerance (1e-8 N on the residual), in "
        "turn in one process on one core.\nMedian time of a load case in ms; loads for which "
        "either way needs several steps are left out.\n\n"
        "| case | DOFs | load cases | tutorial | datagen | ratio | ratio of sums |\n"
        "|---|---|---|---|---|---|---|\n"
        f"{rows}\n{results[0]['machine']}; dolfinx {results[0]['dolfinx']}, PETSc "
        f"{results[0]['petsc']}. Made by `tests/benchmarks/equilibrium.py`.\n"
    )


def main() -> None:
    """Compare in two and three dimensions, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples-2d", type=int, default=500)
    parser.add_argument("--samples-3d", type=int, default=12)
    options = parser.parse_args()
    logging.disable(logging.INFO)
    results = [
        compare("beam2d", options.samples_2d),
        compare("lshape2d", options.samples_2d),
        compare("beam3d", options.samples_3d),
    ]
    for result in results:
        print(json.dumps(result, indent=1))
    write_text(TABLE, table(results))
    command = "OMP_NUM_THREADS=1 .venv-datagen/bin/python tests/benchmarks/equilibrium.py"
    content = {"command": command, "results": results}
    write_text(RESULT, json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
