"""Memory use does not grow with the number of load cases or bodies."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from mpi4py import MPI

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.mesh.geometries import Box
from datagen.solver.load_stepping import solve_load_case

BOUND = 256  # kB; measured: 0 kB over 1000 load cases and 4 kB over 90 bodies


@pytest.fixture(params=["beam2d", "beam3d"])
def case(request: pytest.FixtureRequest) -> Case:
    """The 2D beam, solved by LU, or a coarse 3D beam, solved by multigrid."""
    case = read_case(request.param)
    if request.param == "beam2d":
        return case
    assert isinstance(case.mesh, Box)
    assert case.solver.linear_solver == "multigrid"
    return case.model_copy(update={"mesh": case.mesh.model_copy(update={"elements": (6, 2, 2)})})


def resident() -> int:
    """Resident set size of this process in kB."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1])


def solve(case: Case, body: Body, numbers: Iterable[int]) -> None:
    for number in numbers:
        load = case.loads[0].draw(number, case.dataset.seed, body.loads.loadable)
        assert solve_load_case(body.problem, load.nodes, load.forces, case.solver).solved


@pytest.mark.slow
def test_hundreds_of_load_cases(case: Case) -> None:
    body = make_body(case, MPI.COMM_SELF)
    solve(case, body, range(50))
    before = resident()
    solve(case, body, range(50, 300))
    assert resident() - before < BOUND


@pytest.mark.slow
def test_ten_bodies(case: Case) -> None:
    """As in a long-lived process; without `close` each 3D body would leak 240 kB."""

    def make_and_drop() -> None:
        body = make_body(case, MPI.COMM_SELF)
        solve(case, body, range(3))
        body.problem.close()
        del body
        gc.collect()

    for _ in range(5):
        make_and_drop()
    before = resident()
    for _ in range(10):
        make_and_drop()
    assert resident() - before < BOUND
