"""The preconditioner that turns with the body, and the choice of a linear solver."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.linalg import polar

from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.discretisation.element import Element, element_kind
from datagen.mesh.distributed_mesh import distributed
from datagen.mesh.geometries import Box
from datagen.solver.corotation import rotations
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.linear_solver import CROSSOVER, chosen_solver
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import bent, box


@pytest.mark.parametrize("d", [2, 3])
def test_rotations_are_those_of_the_polar_decomposition(d: int) -> None:
    """F = R U with strains up to 10 %, within 1e-7; no rotation where J <= 0."""
    random = np.random.default_rng(0)
    turned = np.linalg.qr(random.normal(size=(50, d, d)))[0]
    turned[:, 0] *= np.linalg.det(turned)[:, None]
    f = turned @ (np.eye(d) + random.uniform(-0.03, 0.03, (50, d, d)))
    assert rotations(f) == pytest.approx(np.array([polar(each)[0] for each in f]), abs=1e-7)
    mirrored = np.diag([-1.0] + [1.0] * (d - 1))[None]
    assert np.array_equal(rotations(mirrored), np.eye(d)[None])


@pytest.mark.slow
@pytest.mark.parametrize("element", ["linear", "quadratic", "incompressible"])
@pytest.mark.parametrize("simplices", [False, True])
def test_same_equilibria_as_by_lu(element: Element, simplices: bool) -> None:
    """A beam that bends by a fifth of its length: residuals of 1e-9 of the load, so within 1e-7."""
    mesh = distributed(box((4.0, 1.0, 1.0), (12, 3, 3), simplices), MPI.COMM_SELF)
    material = NeoHookean(young_modulus=500, poisson_ratio=0.45)
    found = []
    solvers: tuple[LinearSolver, ...] = ("lu", "corotated")
    for linear_solver in solvers:
        settings = SolverSettings(linear_solver=linear_solver)
        solved = bent(mesh, element, material, (0.0, 0.0, -1.5), settings)
        assert solved.report.solved
        found.append(solved.displacement)
    assert found[1] == pytest.approx(found[0], abs=1e-7)
    assert 0.3 < np.abs(found[0]).max() < 1.2


@pytest.mark.slow
def test_fewer_krylov_iterations_where_the_body_turns() -> None:
    """Four fifths at most of those with a hierarchy that does not turn."""
    case = read_case("beam3d")
    small = Box(lower=(0, 0, 0), upper=(4, 1, 1), elements=(12, 4, 4))
    counts = {}
    solvers: tuple[LinearSolver, ...] = ("multigrid", "corotated")
    for name in solvers:
        solver = case.solver.model_copy(update={"linear_solver": name})
        body = make_body(case.model_copy(update={"mesh": small, "solver": solver}), MPI.COMM_SELF)
        tip = np.array([int(np.abs(body.mesh.coordinates - (4, 1, 1)).sum(1).argmin())])
        assert solve_load_case(body.problem, tip, np.array([[0.0, -2.0, -2.0]]), solver).solved
        counts[name] = body.problem.newton.snes.getLinearSolveIterations()
    assert counts["corotated"] < 0.8 * counts["multigrid"]


@pytest.mark.slow
def test_a_solve_does_not_depend_on_those_before_it() -> None:
    """The same sample, solved first and after others, is equal to the last bit."""
    case = read_case("beam3d")
    small = Box(lower=(0, 0, 0), upper=(4, 1, 1), elements=(12, 4, 4))
    solver = SolverSettings(linear_solver="corotated")
    body = make_body(case.model_copy(update={"mesh": small, "solver": solver}), MPI.COMM_SELF)
    found = []
    for number in (3, 20, 3):
        load = body.loads[number]
        assert solve_load_case(body.problem, load.nodes, load.forces, solver).solved
        found.append(body.problem.displacement())
    assert np.array_equal(found[0], found[2])


@pytest.mark.parametrize(
    ("element", "simplices", "by_multigrid"),
    [("linear", False, True), ("quadratic", True, True), ("incompressible", True, False)],
)
def test_inner_solver_fits_the_element(
    element: Element, simplices: bool, by_multigrid: bool
) -> None:
    """Multigrid for displacements (ν = 0.3), the factors of K₀ where pressures are unknowns."""
    mesh = distributed(box((2.0, 1.0), (6, 3), simplices), MPI.COMM_SELF)
    held = np.isclose(mesh.coordinates[:, 0], 0.0)
    material = NeoHookean(young_modulus=500, poisson_ratio=0.3)
    settings = SolverSettings(linear_solver="corotated")
    problem = EquilibriumProblem(mesh, material, held, settings, element)
    assert problem.corotation is not None
    assert problem.corotation.uses_multigrid == by_multigrid


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "by_multigrid"), [("liver3d", True), ("finger3d", False)], ids=str
)
def test_inner_solver_fits_the_body(case: str, by_multigrid: bool) -> None:
    """On a compact body of ν = 0.45 a whole cycle converges; at 0.49 there are factors."""
    body = make_body(read_case(case), MPI.COMM_SELF)
    corotation = body.problem.corotation
    assert corotation is not None
    assert corotation.uses_multigrid == by_multigrid
    kind = corotation.at_rest.getType()
    assert kind == ("gamg" if by_multigrid else "cholesky")
    before = corotation.at_rest.getMGType() if by_multigrid else None
    with corotation.symmetric():
        pass
    assert before == (corotation.at_rest.getMGType() if by_multigrid else None)
    body.problem.close()


def test_auto_depends_on_size_and_dimension() -> None:
    """LU below the measured crossovers, the corotated solver above; what is asked for is used."""
    quad = element_kind("linear", "quad")
    for d, unknowns in CROSSOVER.items():
        assert chosen_solver("auto", quad, d, unknowns - 1) == "lu"
        assert chosen_solver("auto", quad, d, unknowns) == "corotated"
        assert chosen_solver("multigrid", quad, d, 10) == "multigrid"
        assert chosen_solver("lu", quad, d, 10**6) == "lu"
    mixed = element_kind("incompressible", "tetra")
    assert chosen_solver("auto", mixed, 3, 10**5) == "corotated"
    with pytest.raises(InputError, match=r"'solver.linear_solver' = 'multigrid': expected auto"):
        chosen_solver("multigrid", mixed, 3, 10**5)
