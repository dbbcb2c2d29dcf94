r"""A rigid sphere on a half space: Hertz's force of small depths.

.. math:: F = \tfrac43 \frac{E}{1 - ν^2} \sqrt R \, δ^{3/2}

(Johnson 1985, *Contact Mechanics*, chapter 4). A quarter of a block, 130 times as wide as the
contact, stands for the half space; its hexahedra grow from the contact on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

from datagen.mesh.distributed_mesh import distributed
from datagen.solver.contact.tool_contact import touched
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.materials import NeoHookean
from shared_schema.tools import Sphere
from tests.datagen.solver.cantilever import box

RADIUS, DEPTH, YOUNG, POISSON = 20.0, 0.01, 1000.0, 0.3  # m and Pa; the contact's radius is 0.45 m
SIZE, FIRST, EQUAL, CELLS = 60.0, 0.12, 4, 17  # m; equal cells of the first size, and all


def graded() -> np.ndarray:
    """Positions along an axis in m: equal cells, then a geometric series to the end."""
    rest = SIZE - EQUAL * FIRST

    def excess(ratio: float) -> float:
        return float(FIRST * (ratio ** np.arange(1, CELLS - EQUAL + 1)).sum() - rest)

    ratio = brentq(excess, 1.0, 4.0, xtol=1e-12)
    sizes = np.append(np.full(EQUAL, FIRST), FIRST * ratio ** np.arange(1, CELLS - EQUAL + 1))
    return np.concatenate([[0.0], np.cumsum(sizes)])


@pytest.mark.slow
def test_force_of_hertz() -> None:
    """Within 2 %; meshes with smaller cells give +1.0 to +1.9 %. No node is inside."""
    raw = box((1.0,) * 3, (CELLS,) * 3, simplices=False)
    places, lines = np.rint(CELLS * raw.coordinates).astype(int), graded()
    x = np.column_stack([lines[places[:, 0]], lines[places[:, 1]], -lines[CELLS - places[:, 2]]])
    mesh = distributed(replace(raw, coordinates=x), MPI.COMM_SELF)
    x = mesh.coordinates
    held = np.column_stack([x[:, 0] == 0, x[:, 1] == 0, np.zeros(len(x), bool)])
    held[np.isclose(x[:, 2], -SIZE)] = True
    settings = SolverSettings(linear_solver="lu")
    material = NeoHookean(young_modulus=YOUNG, poisson_ratio=POISSON)
    problem = EquilibriumProblem(mesh, material, held, settings)
    tool = Sphere((0.0, 0.0, RADIUS), RADIUS + DEPTH)
    top = np.flatnonzero((x[:, 2] == 0) & (np.hypot(x[:, 0], x[:, 1]) < SIZE / 4))
    problem.load.contact = touched(problem, tool, top)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 3))
    assert solve_load_case(problem, *nothing, settings).solved
    contact = problem.load.contact.found(problem.displacement())
    hertz = 4 / 3 * YOUNG / (1 - POISSON**2) * RADIUS**0.5 * DEPTH**1.5
    assert -4 * contact.reaction[2] == pytest.approx(hertz, rel=0.02)
    assert contact.penetration < 1e-12
    assert contact.nodes > 10
