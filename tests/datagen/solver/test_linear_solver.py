"""Linear solvers: multigrid against LU, rigid-body modes, what turns with the body, the choice.

Newton's method begins from the path of equilibria as a power series.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.linalg import polar
from scipy.sparse import diags, kronsum

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case, read_case
from datagen.discretisation.element import Element, element_kind
from datagen.mesh.distributed_mesh import distributed
from datagen.mesh.geometries import Box
from datagen.solver.corotation import rotations
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.linear_solver import CROSSOVER, chosen_solver, factors, rigid_body_modes
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from shared_schema.actuators import pressed
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.common.errors import InputError, WorkError
from shared_schema.materials import NeoHookean
from shared_schema.samples.results import SolveReport
from tests.datagen.solver.cantilever import bent, box

SIZE, CELLS = (4.0, 1.0, 1.0), (8, 2, 2)
SOFT = NeoHookean(young_modulus=500.0, poisson_ratio=0.45)
Array = NDArray[np.float64]


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
        for number in range(0, 28, 7):
            load = case.loads[0].draw(number, 0, beam.loads.loadable)
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
@pytest.mark.parametrize("name", ["multigrid", "corotated"])
def test_a_solve_does_not_depend_on_those_before_it(name: str) -> None:
    """The same sample, solved first and after others, is equal to the last bit."""
    case, beam = body(name)
    found = []
    for number in (3, 20, 3):
        load = beam.loads[number]
        assert solve_load_case(beam.problem, load.nodes, load.forces, case.solver).solved
        found.append(beam.problem.displacement())
    assert np.array_equal(found[0], found[2])


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
    monkeypatch.setattr("datagen.solver.linear_solver.WORKSPACE", (-80, 20))
    factors(matrix, definite=True).apply(b, x)
    assert (matrix * x - b).norm() < 1e-9 * b.norm()
    monkeypatch.setattr("datagen.solver.linear_solver.WORKSPACE", (-80, -90))
    with pytest.raises(WorkError, match=r"MUMPS cannot factorise .* \(INFOG\(1\) = -9\)"):
        factors(matrix, definite=True)


@dataclass
class Beam:
    """A beam under a force at a corner, a pressure below, and a grip at the end if wanted."""

    problem: EquilibriumProblem
    corner: NDArray[np.int64]
    moved: NDArray[np.bool_]

    def solve(self, share: float, begins: bool = True) -> tuple[Array, SolveReport]:
        """Solve under a share of the load, from its series or from rest."""
        series, settings = self.problem.series, SolverSettings(linear_solver="corotated")
        self.problem.series = series if begins else None
        forces, pressures = share * np.array([[0.0, 1.0, -1.0]]), share * np.array([3.0])
        moves = np.where(self.moved, 0.5 * share, 0.0)
        report = solve_load_case(
            self.problem, self.corner, forces, settings, pressed(pressures), moves
        )
        self.problem.series = series
        assert report.solved
        return self.problem.state()[: self.problem.unknowns.owned], report


def beam(element: Element, simplices: bool = False, grips: bool = False) -> Beam:
    """Make the beam; linear systems at rest are solved to rounding."""
    mesh = distributed(box(SIZE, CELLS, simplices), MPI.COMM_SELF)
    x = mesh.coordinates
    facets = outward_facets(x, mesh.cells, mesh.cell_type)
    below = facets[(x[facets][:, :, 2] == 0).all(axis=1)]
    moved = np.zeros(x.shape, bool)
    moved[(x[:, 0] == SIZE[0]) & (x[:, 2] == 0), 2] = grips
    settings = SolverSettings(linear_solver="corotated")
    held, corner = x[:, 0] == 0, np.array([int(np.abs(x - SIZE).sum(1).argmin())])
    problem = EquilibriumProblem(
        mesh, SOFT, held, settings, element, moved=moved, following=[PressedSurface(below)]
    )
    assert problem.series is not None
    problem.series.at_rest.setTolerances(rtol=1e-12)
    return Beam(problem, corner, moved)


@pytest.mark.parametrize(
    ("element", "simplices", "grips"),
    [
        ("linear", False, False),
        ("linear", True, True),
        ("incompressible", False, True),
        ("incompressible", True, False),  # dilations and pressures are unknowns
        ("quadratic", True, False),
    ],
)
def test_terms_are_those_of_the_path(element: Element, simplices: bool, grips: bool) -> None:
    """What three terms leave of equilibria is of fourth order in the load."""
    body = beam(element, simplices, grips)
    left = []
    for share in (0.2, 0.1):
        equilibrium, _ = body.solve(share)
        assert body.problem.series is not None
        terms = body.problem.series.terms
        assert len(terms) == 3
        left.append(np.linalg.norm(sum(terms) - equilibrium))
        assert left[-1] < 1e-3 * np.linalg.norm(equilibrium)
    assert 12 < left[0] / left[1] < 20


def test_newton_begins_nearer_to_the_same_equilibrium() -> None:
    """Under a large load fewer iterations lead to it, whatever the accuracy of the terms."""
    body = beam("linear")
    expected, from_rest = body.solve(1.0, begins=False)
    for tolerance in (1e-12, 1e-2):
        assert body.problem.series is not None
        body.problem.series.at_rest.setTolerances(rtol=tolerance)
        found, report = body.solve(1.0)
        assert found == pytest.approx(expected, abs=1e-7)
        assert report.newton_iterations < from_rest.newton_iterations
    assert np.abs(expected).max() > 1.0


def test_passes_through_equilibria_that_are_found() -> None:
    """Each adds a term; further on, the sum is nearer to the path than before."""
    body = beam("linear")
    found = {share: body.solve(share)[0] for share in (0.4, 0.7, 1.0)}
    series, unknowns = body.problem.series, body.problem.unknowns
    assert series is not None
    series.expand()  # under the whole load
    far = [np.linalg.norm(sum(series.terms) - found[1.0])]
    for share in (0.4, 0.7):
        unknowns.set_owned(found[share])
        series.pass_through(share)
        series.begin(share)
        assert unknowns.state.x.array == pytest.approx(found[share], abs=1e-12)
        series.begin(1.0)
        far.append(np.linalg.norm(unknowns.state.x.array - found[1.0]))
    assert far[2] < 0.5 * far[1] < 0.25 * far[0]


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
@pytest.mark.parametrize(
    ("element", "simplices"), [("linear", False), ("quadratic", True), ("incompressible", True)]
)
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
    counts = {}
    for name in ("multigrid", "corotated"):
        case, bent_body = body(name)
        x, problem = bent_body.mesh.coordinates, bent_body.problem
        tip = np.array([int(np.abs(x - (4, 1, 1)).sum(1).argmin())])
        assert solve_load_case(problem, tip, np.array([[0.0, -2.0, -2.0]]), case.solver).solved
        counts[name] = problem.newton.snes.getLinearSolveIterations()
    assert counts["corotated"] < 0.8 * counts["multigrid"]


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
    problem = make_body(read_case(case), MPI.COMM_SELF).problem
    corotation = problem.corotation
    assert corotation is not None
    assert corotation.uses_multigrid == by_multigrid
    kind = corotation.at_rest.getType()
    assert kind == ("gamg" if by_multigrid else "cholesky")
    before = corotation.at_rest.getMGType() if by_multigrid else None
    with corotation.symmetric():
        pass
    assert before == (corotation.at_rest.getMGType() if by_multigrid else None)
    problem.close()


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
