"""Multigrid against LU, and the rigid-body modes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import diags, kronsum

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.mesh.box import Box
from datagen.solver import linear_solver
from datagen.solver.linear_solver import factors, rigid_body_modes
from datagen.solver.load_stepping import solve_load_case
from shared_schema.common.errors import WorkError


def body(linear_solver: str) -> tuple[Case, Body]:
    case = read_case("beam3d")
    small = Box(lower=(0, 0, 0), upper=(4, 1, 1), elements=(12, 4, 4))
    solver = case.solver.model_copy(update={"linear_solver": linear_solver})
    case = case.model_copy(update={"mesh": small, "solver": solver})
    return case, make_body(case, MPI.COMM_SELF)


@pytest.mark.slow
def test_multigrid_and_lu_find_the_same_equilibria() -> None:
    """Residuals of 1e-8 N, over the smallest stiffness of about 1 N/m: within 1e-7 m."""
    solutions = []
    for name in ("lu", "multigrid"):
        case, beam = body(name)
        found = []
        for number in range(8):
            load = case.loads[0].draw(number * 7, 0, beam.loads.loadable)
            report = solve_load_case(beam.problem, load.nodes, load.forces, case.solver)
            assert report.solved
            assert report.residual_norm < 1e-8
            found.append(beam.problem.displacement())
        solutions.append(np.array(found))
    assert solutions[0] == pytest.approx(solutions[1], abs=1e-7)
    assert np.abs(solutions[0]).max() > 0.5


BUCKLING = np.array([[-6.0, 0.0, 0.0]])  # near Euler's load π² E I / 4 L² = 6.4 N


@pytest.mark.slow
@pytest.mark.parametrize("gives_up", [False, True])
def test_where_the_tangent_is_not_positive_definite(
    node_at: Callable[..., int], gives_up: bool
) -> None:
    """Force along the beam: multigrid, or LU after multigrid has failed, finds LU's equilibrium."""
    found = []
    for name in ("lu", "multigrid"):
        case, beam = body(name)
        if gives_up and name == "multigrid":
            beam.problem.newton.snes.getKSP().setTolerances(max_it=3)
        tip = np.array([node_at(beam.mesh.coordinates, 4.0, 1.0, 1.0)])
        report = solve_load_case(beam.problem, tip, BUCKLING, case.solver)
        assert report.solved
        assert report.residual_norm < 1e-8
        found.append(beam.problem.displacement())
    assert found[0] == pytest.approx(found[1], abs=1e-6)


@pytest.mark.slow
def test_a_solve_does_not_depend_on_those_before_it() -> None:
    """The same sample, solved first and after others, is equal to the last bit."""
    case, beam = body("multigrid")
    loads = [case.loads[0].draw(n, 0, beam.loads.loadable) for n in (3, 20, 40, 3)]
    found = []
    for load in loads:
        solve_load_case(beam.problem, load.nodes, load.forces, case.solver)
        found.append(beam.problem.displacement())
    assert np.array_equal(found[0], found[3])


@pytest.mark.parametrize(("dimension", "count"), [(2, 3), (3, 6)])
def test_rigid_body_modes(dimension: int, count: int) -> None:
    """3 in the plane, 6 in space, orthonormal, each without strain: u(x) = a + W x, W = −Wᵀ."""
    points = np.random.default_rng(0).normal(size=(30, dimension))
    matrix = PETSc.Mat().createAIJ((30 * dimension, 30 * dimension), nnz=1)
    matrix.setUp()
    modes = np.array([v.array_r for v in rigid_body_modes(matrix, points).getVecs()])
    assert modes @ modes.T == pytest.approx(np.eye(count), abs=1e-12)
    affine = np.column_stack((np.ones(30), points))
    for mode in modes.reshape(count, 30, dimension):
        fitted, *_ = np.linalg.lstsq(affine, mode, rcond=None)
        gradient = fitted[1:]
        assert affine @ fitted == pytest.approx(mode, abs=1e-12)
        assert gradient + gradient.T == pytest.approx(np.zeros((dimension, dimension)), abs=1e-12)


def laplacian(n: int) -> PETSc.Mat:
    """Seven-point stencil on n³ points."""
    line = diags([-1.0, 2.0, -1.0], [-1, 0, 1], (n, n))
    matrix = kronsum(kronsum(line, line), line).tocsr()
    found = PETSc.Mat().createAIJ(matrix.shape, csr=(matrix.indptr, matrix.indices, matrix.data))
    found.assemble()
    return found


def test_mumps_gets_more_memory_where_its_estimate_is_too_small(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fifth of the estimate fails (INFOG(1) = -9), and PETSc would go on with infinities."""
    matrix = laplacian(20)
    x, b = matrix.createVecs()
    b.set(1.0)
    monkeypatch.setattr(linear_solver, "WORKSPACE", (-80, 20))
    factors(matrix, definite=True).apply(b, x)
    assert (matrix * x - b).norm() < 1e-9 * b.norm()
    monkeypatch.setattr(linear_solver, "WORKSPACE", (-80, -90))
    with pytest.raises(WorkError, match=r"MUMPS cannot factorise .* \(INFOG\(1\) = -9\)"):
        factors(matrix, definite=True)
