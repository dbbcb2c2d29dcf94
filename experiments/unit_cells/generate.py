"""Unit cells of random holes and stretches, meshed by gmsh and solved by dolfinx.

    python -m experiments.unit_cells.generate FOLDER COUNT

in the environment of `datagen` writes one file for each cell that is not there yet. A cell depends
on its number alone. A number without an equilibrium has a file without an end, ``.failed``.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.mesh import RawMesh, distributed, gmsh_session, mesh_of
from datagen.solver import (
    EquilibriumProblem,
    SolverSettings,
    deformation_gradient,
    energy_density,
    solve_load_case,
)
from experiments.unit_cells.unit_cell import Prediction, UnitCell, write_cell
from shared_schema import NeoHookean
from shared_schema.common import Progress

MATERIAL = NeoHookean(young_modulus=1.0, poisson_ratio=0.3)
MOST_HOLES, POROSITY, SPREAD = 9, (0.08, 0.35), (0.6, 1.4)  # spread of radii about their mean
BETWEEN = 0.04  # least distance between holes, and from the outer edge
TRIES = 10_000
STRETCHES, SHEARS = (0.85, 1.25), (-0.15, 0.15)  # components of U
CELL_SIZE = 1 / 73
PROCESSES = 2
Array = NDArray[np.float64]


def random_holes(random: np.random.Generator) -> Array:
    """Middles and radii of 1 to 9 holes in the unit square, (n_holes, 3), the largest first."""
    count = int(random.integers(1, MOST_HOLES + 1))
    radii = random.uniform(*SPREAD, count)
    radii = np.sort(radii * np.sqrt(random.uniform(*POROSITY) / (np.pi * (radii**2).sum())))[::-1]
    holes: list[tuple[float, float, float]] = []
    for _ in range(TRIES):
        if len(holes) == count:
            return np.array(holes)
        radius = float(radii[len(holes)])
        x, y = random.uniform(radius + BETWEEN, 1 - radius - BETWEEN, 2)
        if all(np.hypot(x - a, y - b) > radius + r + BETWEEN for a, b, r in holes):
            holes.append((x, y, radius))
    return random_holes(random)


def meshed(holes: Array) -> RawMesh:
    """Mesh of triangles of the unit square without the holes."""
    with gmsh_session() as gmsh:
        factory = gmsh.model.occ
        square = factory.addRectangle(0, 0, 0, 1, 1)
        disks = [(2, factory.addDisk(x, y, 0, radius, radius)) for x, y, radius in holes]
        if disks:
            factory.cut([(2, square)], disks)
        factory.synchronize()
        for option in ("MeshSizeMin", "MeshSizeMax"):
            gmsh.option.setNumber(f"Mesh.{option}", CELL_SIZE)
        gmsh.model.mesh.generate(2)
        return mesh_of(gmsh.model)


def random_stretch(random: np.random.Generator) -> Array:
    """C₁₁, C₁₂ and C₂₂ of a random U."""
    (first, second), shear = random.uniform(*STRETCHES, 2), random.uniform(*SHEARS)
    c = np.linalg.matrix_power(np.array([[first, shear], [shear, second]]), 2)
    return np.array([c[0, 0], c[0, 1], c[1, 1]])


def solved(mesh: RawMesh, stretch: Array) -> UnitCell | None:
    """Solve one cell; None if there is no equilibrium."""
    zeros = Prediction(np.zeros((len(mesh.coordinates), 7)), 0.0)
    cell = UnitCell(mesh.coordinates, mesh.cells, stretch, zeros)
    held = np.repeat(cell.is_outer[:, None], 2, axis=1)
    settings = SolverSettings(linear_solver="lu")
    problem = EquilibriumProblem(
        distributed(mesh, MPI.COMM_SELF), MATERIAL, np.zeros_like(held), settings, moved=held
    )
    nothing = np.zeros(0, np.int64), np.zeros((0, 2))
    moved = np.where(held, cell.homogeneous, 0.0)
    report = solve_load_case(problem, *nothing, settings, displacement=moved)
    solution = Prediction(fields_of(problem), problem.energy() / float(cell.sides.prod()))
    problem.close()
    return replace(cell, solution=solution) if report.solved else None


def fields_of(problem: EquilibriumProblem) -> Array:
    """Displacement, and means of stress and energy density around every node by volume."""
    displacement, domain, state = problem.displacement(), problem.mesh.domain, problem.state()
    f = ufl.variable(deformation_gradient(problem.u))
    psi = energy_density(f, MATERIAL, domain)
    p, v = ufl.diff(psi, f), ufl.TestFunction(problem.u.function_space)
    one = ufl.as_vector((1.0, 1.0))
    parts = [p[0, :], p[1, :], psi * one, one]
    vectors = [dolfinx.fem.form(ufl.inner(part, v) * ufl.dx) for part in parts]
    sums = []
    for vector in vectors:
        problem.restore(state)
        integrals = dolfinx.fem.assemble_vector(vector).array.copy()
        problem.restore(integrals)  # so that it is gathered in the order of the nodes
        sums.append(problem.displacement())
    problem.restore(state)
    (p11, p12), (p21, p22), (energy, _) = ((part / sums[-1]).T for part in sums[:-1])
    return np.column_stack([displacement, p11, p12, p22, p21, energy])


def generate(folder: Path, number: int) -> None:
    """Write one cell."""
    random = np.random.default_rng([2026, number])
    mesh = meshed(random_holes(random))
    cell = solved(mesh, random_stretch(random))
    if cell is None:
        (folder / f"{number:05d}.failed").touch()
    else:
        unfinished = folder / f"{number:05d}.unfinished.npz"
        write_cell(unfinished, cell)
        unfinished.rename(folder / f"{number:05d}.npz")


def main(folder: Path, count: int) -> None:
    """Write all cells that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for unfinished in folder.glob("*.unfinished.npz"):
        unfinished.unlink()
    done = {int(path.stem) for path in folder.iterdir()}
    progress = Progress(count, len(done), "cells", "unit cells")
    with ProcessPoolExecutor(PROCESSES, get_context("spawn")) as pool:
        wanted = [n for n in range(count) if n not in done]
        for finished in as_completed([pool.submit(generate, folder, n) for n in wanted]):
            finished.result()
            done.add(-1 - len(done))
            progress.update(len(done))
    progress.close("done")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
