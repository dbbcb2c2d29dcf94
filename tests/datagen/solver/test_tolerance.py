"""The tolerance fits the body: from nanonewtons on micrometres to meganewtons on tens of metres."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from mpi4py import MPI

from datagen.mesh.distributed_mesh import make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.materials import NeoHookean
from shared_schema.samples.results import SolveReport


@cache
def bent(
    length: float,
    modulus: float,
    force: float,
    elements: tuple[int, ...] = (12, 3),
    linear_solver: LinearSolver = "auto",
    tolerance: float | None = None,
) -> tuple[np.ndarray, SolveReport, EquilibriumProblem]:
    """Displacement over length of a beam, 4 times as long as thick, under a force at its tip."""
    upper = (length, *(length / 4 for _ in elements[1:]))
    mesh = make_mesh(Box(lower=(0.0,) * len(upper), upper=upper, elements=elements), MPI.COMM_SELF)
    x = mesh.coordinates / length
    settings = SolverSettings(linear_solver=linear_solver, tolerance=tolerance)
    material = NeoHookean(young_modulus=modulus, poisson_ratio=0.4)
    problem = EquilibriumProblem(mesh, material, np.isclose(x[:, 0], 0.0), settings)
    tip = int(np.abs(x - np.asarray(upper) / length).sum(axis=1).argmin())
    load = np.zeros((1, len(upper)))
    load[0, -1] = -force
    report = solve_load_case(problem, np.array([tip]), load, settings)
    return problem.displacement() / length, report, problem


@pytest.mark.parametrize(
    ("length", "force"),
    [
        (4e-6, 1e-9),  # 1 nN on micrometres
        (1e-3, 5e-9),  # a beam of 1 mm
        (1e-3, 2e-8),
        (100.0, 0.3),  # 100 mm, N and MPa
        (40.0, 1e6),  # 1 MN on tens of metres
    ],
)
@pytest.mark.parametrize("linear_solver", ["lu", "corotated", "multigrid"])
def test_the_same_body_of_any_size(
    length: float, force: float, linear_solver: LinearSolver
) -> None:
    """In the plane u / L depends on f / (E L) only: E is chosen so that it is 1.25e-3."""
    expected, reference, _ = bent(4.0, 500.0, 2.5, linear_solver=linear_solver)
    u, report, problem = bent(length, force / (1.25e-3 * length), force, (12, 3), linear_solver)
    assert reference.solved
    assert report.solved
    assert report.newton_iterations == reference.newton_iterations
    assert u == pytest.approx(expected, abs=1e-8)
    assert np.abs(expected).max() > 0.2
    assert report.residual_norm <= 1e-9 * force
    assert problem.tolerance() == pytest.approx(1e-9 * force)


@pytest.mark.parametrize("elements", [(12, 3), (12, 3, 3)])
@pytest.mark.parametrize("linear_solver", ["lu", "corotated", "multigrid"])
@pytest.mark.parametrize("force", [1e-20, 1e-3])
def test_small_loads_move_a_stiff_body_linearly(
    elements: tuple[int, ...], linear_solver: LinearSolver, force: float
) -> None:
    """A beam of steel: u / f is that of 1 N, down to loads that rounding hides."""
    expected, _, _ = bent(4.0, 2e11, 1.0, elements, linear_solver)
    u, report, problem = bent(4.0, 2e11, force, elements, linear_solver)
    assert report.solved
    assert report.newton_iterations >= 1
    assert u / force == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
    assert report.residual_norm <= problem.tolerance()


def test_an_absolute_tolerance_still_makes_an_iteration() -> None:
    """5e-9 N on a beam of 1 mm, with a tolerance of 1e-8 N: within 1 % of the relative one."""
    modulus = 5e-9 / (1.25e-4 * 1e-3)
    expected, _, _ = bent(1e-3, modulus, 5e-9)
    u, report, _ = bent(1e-3, modulus, 5e-9, tolerance=1e-8)
    assert report.solved
    assert report.newton_iterations >= 1
    assert u == pytest.approx(expected, abs=0.01 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.02


def test_no_load_moves_nothing() -> None:
    u, report, _ = bent(4.0, 500.0, 0.0)
    assert report.solved
    assert not u.any()


def test_one_tolerance_at_a_time() -> None:
    """The unused one does not appear in the configuration; both are refused."""
    assert "relative_tolerance" not in SolverSettings(tolerance=1e-8).model_dump()
    assert SolverSettings().model_dump()["relative_tolerance"] == 1e-9
    assert "tolerance" not in SolverSettings().model_dump()
    with pytest.raises(InputError, match="expected one of them"):
        validate(SolverSettings, {"tolerance": 1e-8, "relative_tolerance": 1e-6}, "case")


@pytest.mark.parametrize("linear_solver", ["lu", "corotated", "multigrid"])
def test_an_absolute_tolerance_passes_no_body_that_hardly_moved(
    linear_solver: LinearSolver,
) -> None:
    """0.4 nN on 40 µm, with the 1e-8 N of the shipped cases: it counts as 1e-6 of the load."""
    force = 0.4e-9
    modulus = force / (1.25e-3 * 40e-6)
    expected, _, _ = bent(40e-6, modulus, force)
    u, report, problem = bent(40e-6, modulus, force, (12, 3), linear_solver, tolerance=1e-8)
    assert report.solved
    assert problem.tolerance() == pytest.approx(1e-6 * force)
    assert u == pytest.approx(expected, abs=1e-6)
    assert np.abs(expected).max() > 0.2


def test_an_absolute_tolerance_below_rounding_errors() -> None:
    """1 MN on tens of metres, with the 1e-8 N of the shipped cases: rounding decides."""
    expected, _, _ = bent(4.0, 500.0, 2.5)
    u, report, problem = bent(40.0, 1e6 / (1.25e-3 * 40.0), 1e6, tolerance=1e-8)
    assert report.solved
    assert 1e-8 < problem.tolerance() < 1e-9 * 1e6
    assert u == pytest.approx(expected, abs=1e-8)
