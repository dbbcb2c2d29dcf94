"""A block of rubber, at rest and in motion, held against CalculiX, if it is installed.

And a breast against AceFEM.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

import datagen
from datagen.cases.case import read_case
from datagen.cases.placed_body import placed
from datagen.mesh.distributed_mesh import distributed
from datagen.motion.time_stepping import Motion, inertia_of
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import MooneyRivlin
from shared_schema.motion import LoadOverTime, TimeSettings
from tests.datagen.solver.cantilever import box

CCX = shutil.which("ccx")
C10, BULK = 80.0, 400.0  # Pa: W = C10 (Ī₁ − 3) + K/2 (J − 1)², which CalculiX calls NEO HOOKE
DENSITY = 100.0  # kg/m³: the slowest vibration takes 11 s
UPPER, CELLS, FORCE = (2.0, 1.0, 1.0), (6, 3, 3), (2.0, -6.0, 4.0)  # m; N
DIGITS = 2e-6  # of the largest displacement: CalculiX prints seven digits
Array = NDArray[np.float64]
ROOT = Path(__file__).parents[3]
ACEFEM = ROOT / "experiments/organs/breast_acefem.txt"  # u in m, saurabhdeshpande93/MAgNET, MIT
BODY_FORCE = (-5941.76154725, -5233.60075768, -2561.67423583)  # N/m³, fitted to that solution


def by_calculix(
    raw: RawMesh,
    clamped: NDArray[np.bool_],
    nodes: NDArray[np.int64],
    forces: Array,
    folder: Path,
    procedure: str,
) -> Array:
    """Displacement of the nodes at the end of every increment in m, (n, n_nodes, 3).

    Under forces in N, (m, 3), of some nodes.
    """

    def lines(rows: NDArray[Any]) -> str:
        numbered = enumerate(rows.tolist(), start=1)
        return "\n".join(f"{number}, {', '.join(map(repr, row))}" for number, row in numbered)

    numbers = np.arange(1, len(raw.coordinates) + 1)
    each = zip(nodes + 1, forces.tolist(), strict=True)
    loads = "\n".join(f"{n}, {i}, {f!r}" for n, of in each for i, f in enumerate(of, start=1))
    deck = f"""*NODE, NSET=ALL
{lines(raw.coordinates)}
*ELEMENT, TYPE=C3D4, ELSET=BODY
{lines(raw.cells + 1)}
*MATERIAL, NAME=RUBBER
*HYPERELASTIC, NEO HOOKE
{C10}, {2 / BULK}
*DENSITY
{DENSITY}
*SOLID SECTION, ELSET=BODY, MATERIAL=RUBBER
*BOUNDARY
{chr(10).join(f"{n}, 1, 3" for n in numbers[clamped])}
*STEP, NLGEOM, INC=2000
{procedure}
*CONTROLS, PARAMETERS=FIELD
1e-8, 1e-8
*CLOAD
{loads}
*NODE PRINT, NSET=ALL
U
*END STEP
"""
    (folder / "block.inp").write_text(deck)
    assert CCX is not None
    done = subprocess.run([CCX, "block"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    frames = []
    for printed in (folder / "block.dat").read_text().split("displacements")[1:]:
        rows = [line.split() for line in printed.splitlines() if len(line.split()) == 4]
        found = np.array(rows, dtype=np.float64)
        assert len(found) == len(raw.coordinates)
        frames.append(found[np.argsort(found[:, 0]), 1:])
    return np.array(frames)


@pytest.mark.skipif(CCX is None, reason="no CalculiX (apt-get install calculix-ccx)")
def test_block_of_rubber(tmp_path: Path) -> None:
    raw = box(UPPER, CELLS, simplices=True)
    clamped = np.isclose(raw.coordinates[:, 0], 0.0)
    load = np.array([raw.coordinates.sum(axis=1).argmax()]), np.array([FORCE])
    expected = by_calculix(raw, clamped, *load, tmp_path, "*STATIC\n0.25, 1.0")[-1]
    mesh = distributed(raw, MPI.COMM_SELF)
    material = MooneyRivlin(c10=C10, c01=0.0, bulk_modulus=BULK)
    settings = SolverSettings(linear_solver="lu")
    problem = EquilibriumProblem(mesh, material, clamped, settings)
    assert solve_load_case(problem, *load, settings).solved
    largest = float(np.abs(expected).max())
    assert largest > 0.1
    np.testing.assert_allclose(problem.displacement(), expected, rtol=0, atol=DIGITS * largest)


@pytest.mark.skipif(CCX is None, reason="no CalculiX (apt-get install calculix-ccx)")
def test_block_that_is_loaded_at_once(tmp_path: Path) -> None:
    """Paths by the trapezoidal rule there and the midpoint rule here.

    0.9 % apart, and 0.25 % with cells of half the size: the masses of a cell differ.
    """
    raw, h, steps = box(UPPER, CELLS, simplices=True), 0.05, 120
    clamped = np.isclose(raw.coordinates[:, 0], 0.0)
    nodes = np.flatnonzero(~clamped)
    forces = np.tile(np.array(FORCE) / len(nodes), (len(nodes), 1))
    procedure = f"*DYNAMIC, DIRECT, ALPHA=0\n{h}, {h * steps}"
    expected = by_calculix(raw, clamped, nodes, forces, tmp_path, procedure)
    mesh = distributed(raw, MPI.COMM_SELF)
    material = MooneyRivlin(c10=C10, c01=0.0, bulk_modulus=BULK, density=DENSITY)
    problem = EquilibriumProblem(mesh, material, clamped, SolverSettings(linear_solver="lu"))
    problem.set_load(nodes, forces)
    time = TimeSettings(duration=h * steps, step=h, dissipation=1.0)
    inertia = inertia_of(problem, material, None, time)
    motion = Motion(problem, time, inertia, LoadOverTime.of("held"))
    found = []
    for _ in range(steps):
        motion.step()
        found.append(problem.displacement())
    largest = float(np.abs(expected).max())
    assert largest > 0.2
    assert expected.shape == (steps, *raw.coordinates.shape)
    assert np.abs(found - expected).max() < 0.015 * largest


def test_breast_under_a_body_force() -> None:
    """Equal to AceFEM's solution to 1e-9 of the largest displacement, 0.0656 m."""
    published = np.loadtxt(ACEFEM)
    solution = datagen.solve("breast3d", body_force=BODY_FORCE)
    assert np.abs(published).max() == pytest.approx(0.0487, abs=1e-4)
    error = np.abs(solution.displacement - published).max()
    assert error <= 1e-9 * np.linalg.norm(published, axis=1).max()


@pytest.mark.parametrize(
    ("name", "nodes", "clamped"), [("breast3d", 1035, 224), ("liver3d", 3057, 168)]
)
def test_bodies(name: str, nodes: int, clamped: int) -> None:
    """Nodes and supports are as many as the authors published."""
    case = read_case(name)
    body = placed(case, case.mesh.raw_mesh())
    assert len(body.mesh.coordinates) == nodes
    assert body.clamped.sum() == clamped
