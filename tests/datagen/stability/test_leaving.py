"""Unstable equilibria are left, refused or kept; the buckled column is Euler's elastica."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from datagen.stability.definiteness import is_stable
from datagen.stability.inertia import SymmetricFactor
from datagen.stability.stable_equilibrium import NOT_LEFT, UNSTABLE, with_stability
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import box
from tests.datagen.stability.columns import HEIGHT, LENGTH, MODULUS, Column


@pytest.mark.parametrize(
    ("angle", "part", "x", "y"),
    [(20, 1.015, 0.970, 0.220), (60, 1.152, 0.741, 0.593), (120, 1.884, 0.123, 0.803)],
)
def test_elastica(angle: int, part: float, x: float, y: float) -> None:
    """Place of the end over the length, by the force over Euler's.

    Timoshenko and Gere, *Theory of Elastic Stability*, 1961, Table 2-4, by the angle of the end;
    its three digits of the force leave the smallest deflection to 2 %. Strains are below 2 %.
    """
    column = Column((40, 2), "quadratic")
    settings = column.settings
    report = with_stability(column.problem, column.solve(part * column.euler), settings)
    assert report.solved
    assert report.stable
    along, across = column.end_displacement() / LENGTH
    assert 1 + along == pytest.approx(x, abs=0.015)
    assert abs(across) == pytest.approx(y, rel=0.02 if angle > 20 else 0.04)
    turned = column.problem.displacement()[column.end]
    high, low = turned[column.x[column.end, 1].argmax()], turned[column.x[column.end, 1].argmin()]
    slope = np.arctan2(*((low - high) + [0, -HEIGHT]) * [1, -1])
    assert abs(np.degrees(slope)) == pytest.approx(angle, abs=2.5)


def test_kept_below_the_critical_load() -> None:
    """The straight state, and no iteration more than without a check."""
    column = Column((20, 2))
    report = column.solve(0.9 * column.euler)
    assert with_stability(column.problem, report, column.settings) is report


@pytest.mark.parametrize(
    ("stability", "solved", "text"), [("fail", False, UNSTABLE), ("allow", True, "CONVERGED")]
)
def test_refused_or_kept(stability: str, solved: bool, text: str) -> None:
    column = Column((20, 2))
    before = column.solve(3 * column.euler)
    straight = column.problem.displacement()
    settings = SolverSettings.model_validate({"stability": stability})
    report = with_stability(column.problem, before, settings)
    assert (report.solved, report.stable) == (solved, False)
    assert text in report.explanation
    assert report.load_factor == 1.0
    np.testing.assert_array_equal(column.problem.displacement(), straight)


def test_mirror_image_by_the_seed() -> None:
    """Ten imperfections lead to one state or its mirror image, to both of them; repeatably."""
    column = Column((20, 2))
    mirror = [
        np.flatnonzero(np.isclose(column.x, [a, HEIGHT - b]).all(axis=1))[0] for a, b in column.x
    ]
    found = []
    for seed in (*range(10), 0):
        settings = column.settings.model_copy(update={"imperfection": seed})
        assert with_stability(column.problem, column.solve(4 * column.euler), settings).solved
        found.append(column.problem.displacement())
    assert np.array_equal(found[-1], found[0])
    ups = [displacement[column.end, 1].mean() > 0 for displacement in found]
    assert 0 < sum(ups) < len(ups)
    for displacement, up in zip(found, ups, strict=True):
        same = displacement if up == ups[0] else displacement[mirror] * [1, -1]
        np.testing.assert_allclose(same, found[0], atol=1e-6)


@pytest.mark.parametrize(
    ("element", "simplices", "elements", "linear_solver"),
    [
        ("linear", True, (12, 2), "multigrid"),
        ("quadratic", True, (6, 1), "corotated"),
        ("incompressible", False, (12, 2), "corotated"),
        ("incompressible", True, (6, 1), "lu"),
        ("linear", False, (8, 1, 1), "corotated"),
        ("incompressible", True, (4, 1, 1), "corotated"),
    ],
)
def test_left_with_every_element(
    element: Element, simplices: bool, elements: tuple[int, ...], linear_solver: LinearSolver
) -> None:
    """The end moves sideways, by a tenth of the length at least; the energy is less."""
    column = Column(elements, element, simplices, linear_solver, ratio=0.3)
    report = column.solve(15 * column.euler)
    assert not is_stable(column.problem)
    energy = column.problem.potential()
    found = with_stability(column.problem, report, column.settings)
    assert found.solved
    assert found.stable
    assert found.left
    assert found.residual_norm <= column.problem.tolerance()
    assert found.newton_iterations > report.newton_iterations
    assert np.linalg.norm(column.end_displacement()[1:]) > LENGTH / 10
    assert column.problem.potential() < energy


def test_failure_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without steps no state is found; the unstable one is kept."""
    monkeypatch.setattr("datagen.stability.relaxation.STEPS", 1)
    column = Column((20, 2))
    before = column.solve(3 * column.euler)
    straight = column.problem.displacement()
    report = with_stability(column.problem, before, column.settings)
    assert (report.solved, report.explanation) == (False, NOT_LEFT)
    np.testing.assert_array_equal(column.problem.displacement(), straight)


def test_pressure_that_turns_with_the_end() -> None:
    """It has no static buckling (Beck 1952), though the symmetric part of K is not definite.

    All eigenvalues are positive at ten times Euler's load. A dead force beside it, above Euler's,
    buckles the column; then the straight state is left.
    """
    raw = box((LENGTH, HEIGHT), (20, 2), False)
    x = raw.coordinates
    facets = outward_facets(x, raw.cells, raw.cell_type)
    end = facets[(x[facets][:, :, 0] == LENGTH).all(axis=1)]
    mesh, settings = distributed(raw, MPI.COMM_SELF), SolverSettings()
    material = NeoHookean(young_modulus=MODULUS, poisson_ratio=0.0)
    problem = EquilibriumProblem(mesh, material, x[:, 0] == 0, settings, surfaces=[end])
    euler = np.pi**2 * MODULUS * HEIGHT**3 / 12 / (4 * LENGTH**2)
    nodes = np.unique(end)
    dead = np.tile([-1.0, 0.0], (len(nodes), 1)) / len(nodes)
    for force, pressure, stable in ((0.0, 10 * euler / HEIGHT, True), (3 * euler, 1e-3, False)):
        load = nodes, force * dead, settings, np.array([pressure])
        report = solve_load_case(problem, *load)
        assert report.solved
        factor = SymmetricFactor(problem)
        factor.close()
        assert factor.excess > 0
        assert is_stable(problem) == stable
        found = with_stability(problem, report, settings)
        assert found.solved
        assert found.stable
        assert np.abs(problem.displacement()[:, 1]).max() > LENGTH / 10 or stable
