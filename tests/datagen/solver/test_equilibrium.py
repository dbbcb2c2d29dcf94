"""Equilibria against closed forms and dolfinx's assembly; convergence of Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import dolfinx
import numpy as np
import pytest
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray

import datagen
from datagen.cases.body import Body
from datagen.solver.equilibrium import INVERTED, EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings

ProblemMaker = Callable[..., EquilibriumProblem]
NodeFinder = Callable[..., int]
TOLERANCE = 1e-8  # N
SETTINGS = SolverSettings(tolerance=TOLERANCE)


@pytest.mark.parametrize("stretch", [0.6, 1.7])
@pytest.mark.parametrize("upper", [(2.0, 1.0), (2.0, 1.0, 1.0)])
def test_uniaxial_stretch(
    make_problem: ProblemMaker, upper: tuple[float, ...], stretch: float
) -> None:
    """ν = 0: W = μ/2 (I_c − 3 − 2 ln J), no lateral strain, P₁₁ = μ (a − 1/a) with μ = E/2.

    The trapezoidal rule divides the end force among the nodes; u = (a − 1) X.
    """
    elements = (4, 2, 2)[: len(upper)]
    problem = make_problem(elements, upper, poisson_ratio=0.0)
    x = problem.mesh.coordinates
    end = np.flatnonzero(np.isclose(x[:, 0], upper[0]))
    share = np.ones(len(end))
    for axis in range(1, len(upper)):
        at_edge = np.isclose(x[end, axis], 0.0) | np.isclose(x[end, axis], upper[axis])
        share *= np.where(at_edge, 0.25, 0.5)  # two elements across
    assert share.sum() == pytest.approx(1.0)
    stress = 250.0 * (stretch - 1 / stretch)
    forces = np.zeros((len(end), len(upper)))
    forces[:, 0] = stress * share * np.prod(upper[1:])
    assert solve_load_case(problem, end, forces, SETTINGS).solved
    expected = np.zeros_like(x)
    expected[:, 0] = (stretch - 1) * x[:, 0]
    assert problem.displacement() == pytest.approx(expected, abs=1e-10)


def test_small_loads_give_the_beam_theory_deflection(
    make_problem: ProblemMaker, node_at: NodeFinder
) -> None:
    """Timoshenko's cantilever in plane strain, ν = 0: w = F L³/(3 E I) + F L/(κ G A).

    L = 4 m, h = 1 m, E = 500 Pa, G = 250 Pa, κ = 5/6, F = 1e-4 N; fine mesh, within 1 %.
    """
    problem = make_problem((80, 20), (4.0, 1.0), poisson_ratio=0.0)
    x = problem.mesh.coordinates
    end = np.flatnonzero(np.isclose(x[:, 0], 4.0))
    forces = np.zeros((len(end), 2))
    forces[:, 1] = 1e-4 / 20
    forces[np.isin(x[end, 1], (0.0, 1.0)), 1] /= 2
    assert solve_load_case(problem, end, forces, SolverSettings(tolerance=1e-14)).solved
    theory = 1e-4 * (4**3 / (3 * 500 / 12) + 4 / (5 / 6 * 250))
    tip = node_at(x, 4.0, 0.5)
    assert problem.displacement()[tip, 1] == pytest.approx(theory, rel=0.01)


def test_the_papers_lshape() -> None:
    """The tip moves by 2.39 m, as in the paper's example."""
    found = datagen.solve("lshape2d", "6,2:-0.07,-1")
    tip = int(np.linalg.norm(found.coordinates - (6.0, 2.0), axis=1).argmin())
    assert np.linalg.norm(found.displacement[tip]) == pytest.approx(2.39, rel=0.01)


@pytest.mark.parametrize("force", [(0.0, -2.5), (2.5, 2.5), (-1.7, 0.3)])
def test_reactions_balance_the_load(
    beam: Body, node_at: NodeFinder, force: tuple[float, float]
) -> None:
    """Sum of the reactions = − load, and their moment balances that of the load."""
    x = beam.mesh.coordinates
    tip = node_at(x, 4.0, 1.0)
    load = np.array([force])
    assert solve_load_case(beam.problem, np.array([tip]), load, SETTINGS).solved
    reactions = beam.problem.reactions()
    assert np.abs(reactions[~beam.clamped]).max() < TOLERANCE
    support = reactions[beam.clamped]
    assert support.sum(axis=0) == pytest.approx(-load[0], abs=1e-8)
    position = x[tip] + beam.problem.displacement()[tip]

    def moment(at: NDArray[Any], of: NDArray[Any]) -> float:
        return float(at[0] * of[1] - at[1] * of[0])

    total = sum(moment(a, r) for a, r in zip(x[beam.clamped], support, strict=True))
    assert total == pytest.approx(-moment(position, load[0]), abs=1e-7)


def test_newton_converges_quadratically(beam: Body, node_at: NodeFinder) -> None:
    """Close to the solution ‖R_{k+1}‖ ≤ C ‖R_k‖² with C of order 1/N."""
    norms: list[float] = []
    beam.problem.newton.snes.setMonitor(lambda snes, iteration, norm: norms.append(norm))
    tip = node_at(beam.mesh.coordinates, 4.0, 1.0)
    solve_load_case(beam.problem, np.array([tip]), np.array([[0.0, -2.5]]), SETTINGS)
    beam.problem.newton.snes.cancelMonitor()
    close = [norm for norm in norms if norm < 0.1]
    assert len(close) >= 3
    for before, after in pairwise(close):
        assert after < max(before**2, 1e-11)
    assert norms[-1] < TOLERANCE


def test_no_iteration_is_skipped_on_reuse(beam: Body, node_at: NodeFinder) -> None:
    """A second solve with the same solver converges to the new load, not to the old one."""
    tip = np.array([node_at(beam.mesh.coordinates, 4.0, 1.0)])
    solutions = []
    for force in ((0.0, -2.0), (0.0, 2.0), (0.0, -2.0)):
        report = solve_load_case(beam.problem, tip, np.array([force]), SETTINGS)
        assert report.newton_iterations > 2
        solutions.append(beam.problem.displacement())
    assert np.array_equal(solutions[0], solutions[2])
    assert solutions[0][tip[0], 1] < 0 < solutions[1][tip[0], 1]


@pytest.mark.slow
def test_mesh_refinement_converges(make_problem: ProblemMaker, node_at: NodeFinder) -> None:
    """Differences between successive meshes shrink; singular corners keep the order below 2.

    The load is distributed over the end, since the displacement under a point force has no limit.
    """
    tips = []
    for n in (1, 2, 4, 8):
        problem = make_problem((12 * n, 3 * n), (4.0, 1.0))
        x = problem.mesh.coordinates
        end = np.flatnonzero(np.isclose(x[:, 0], 4.0))
        forces = np.zeros((len(end), 2))
        forces[:, 1] = -2.5 / (3 * n)
        forces[np.isin(x[end, 1], (0.0, 1.0)), 1] /= 2
        assert solve_load_case(problem, end, forces, SETTINGS).solved
        tips.append(problem.displacement()[node_at(x, 4.0, 0.0), 1])
    changes = np.abs(np.diff(tips))
    assert np.all(changes[1:] < 0.45 * changes[:-1])
    assert changes[-1] < 0.01 * abs(tips[-1])


def test_failed_steps_are_cut_back(beam: Body, node_at: NodeFinder) -> None:
    """40 N at the corner invert elements in one load step, and are solved in several steps."""
    tip = np.array([node_at(beam.mesh.coordinates, 4.0, 1.0)])
    force = np.array([[0.0, -40.0]])
    report = solve_load_case(beam.problem, tip, force, SETTINGS)
    assert report.solved
    assert report.cutbacks >= 1
    assert report.load_steps >= 2
    reached = beam.problem.displacement()
    small_steps = SETTINGS.model_copy(update={"first_step": 0.02})
    assert solve_load_case(beam.problem, tip, force, small_steps).cutbacks == 0
    assert beam.problem.displacement() == pytest.approx(reached, abs=1e-8)


def test_inverted_elements_are_refused(beam: Body) -> None:
    """A state with J < 0 is not accepted, even if its residual is finite."""
    x = beam.mesh.coordinates
    beam.problem.set_load(np.array([0]), np.zeros((1, 2)))
    beam.problem.set_displacement(np.stack((-2.0 * x[:, 0], np.zeros(len(x))), axis=1))
    result = beam.problem.solve(1.0)
    assert not result.converged
    assert result.explanation == INVERTED


def test_a_load_without_equilibrium_fails_with_its_reason(beam: Body, node_at: NodeFinder) -> None:
    tip = np.array([node_at(beam.mesh.coordinates, 4.0, 1.0)])
    report = solve_load_case(beam.problem, tip, np.array([[0.0, -1e6]]), SETTINGS)
    assert not report.solved
    assert report.load_factor < 1.0
    assert report.explanation
    assert report.cutbacks > 5


@pytest.mark.parametrize(
    ("elements", "upper"), [((4, 3), (2.0, 1.0)), ((3, 3, 2), (2.0, 1.0, 1.0))]
)
def test_same_matrix_as_dolfinx(
    make_problem: ProblemMaker, elements: tuple[int, ...], upper: tuple[float, ...]
) -> None:
    """Entries are equal up to the order of summation; clamped rows are those of the identity."""
    problem = make_problem(elements, upper, distortion=0.05)
    random = np.random.default_rng(0)
    for scale in (0.0, 0.03):
        shape = problem.mesh.coordinates.shape
        problem.set_displacement(
            random.normal(scale=scale, size=shape) if scale else np.zeros(shape)
        )
        ours = problem.tangent()
        space = problem.u.function_space
        clamped = np.isclose(problem.mesh.coordinates[problem.numbering.node_of_block, 0], 0.0)
        blocks = np.flatnonzero(clamped).astype(np.int32)
        support = dolfinx.fem.dirichletbc(np.zeros(problem.dimension), blocks, space)
        theirs = fem_petsc.assemble_matrix(problem.forms.tangent, bcs=[support])
        theirs.assemble()
        assert np.abs(ours[:, :] - theirs[:, :]).max() < 1e-12 * theirs.norm()
