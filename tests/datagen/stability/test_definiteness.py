"""Stability by pivots, conjugate gradients and factors, against all eigenvalues, and Euler."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from datagen.discretisation.element import Element
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import LinearSolver
from datagen.stability.definiteness import is_stable
from datagen.stability.inertia import pressures_of, unstable_modes
from tests.datagen.stability.columns import Column


def eigenvalues(problem: EquilibriumProblem) -> NDArray[np.float64]:
    """Eigenvalues of K, dilations and pressures eliminated: those of the Hessian of the energy."""
    matrix = problem.tangent()
    k = matrix.getValues(range(problem.size), range(problem.size))
    u = np.zeros(problem.size, dtype=bool)
    u[problem.unknowns.point_dofs.ravel()] = True
    rest = k[~u][:, ~u]
    reduced = k[u][:, u] - k[u][:, ~u] @ np.linalg.solve(rest, k[~u][:, u]) if rest.size else k
    return np.linalg.eigvalsh((reduced + reduced.T) / 2)


@pytest.mark.parametrize("linear_solver", ["lu", "multigrid", "corotated"])
@pytest.mark.parametrize(
    ("element", "simplices", "elements"),
    [
        ("linear", False, (12, 2)),
        ("linear", True, (12, 2)),
        ("quadratic", False, (6, 1)),
        ("quadratic", True, (6, 1)),
        ("incompressible", False, (12, 2)),
        ("incompressible", True, (6, 1)),
        ("linear", False, (8, 1, 1)),
        ("linear", True, (8, 1, 1)),
        ("incompressible", False, (8, 1, 1)),
        ("incompressible", True, (4, 1, 1)),
    ],
)
def test_inertia_is_that_of_all_eigenvalues(
    element: Element, simplices: bool, elements: tuple[int, ...], linear_solver: LinearSolver
) -> None:
    """Far below and above the first critical load of the elements, in space of two modes."""
    if linear_solver == "multigrid" and element == "incompressible" and simplices:
        pytest.skip("multigrid takes no elements with pressures")
    column = Column(elements, element, simplices, linear_solver, ratio=0.3)
    problem, found = column.problem, []
    is_mixed = element == "incompressible" and simplices
    assert (pressures_of(problem) > 0) == is_mixed
    for part in (0.1, 4.0, 15.0, 60.0):
        column.solve(part * column.euler)
        stable = is_stable(problem)
        negative = int((eigenvalues(problem) < 0).sum())
        assert unstable_modes(problem) == negative
        assert stable == (negative == 0)
        found.append(negative)
    assert found[0] == 0
    assert found[-1] >= len(elements) - 1  # one mode, or two at once in a square column


@pytest.mark.parametrize("linear_solver", ["lu", "corotated"])
def test_critical_load_is_that_of_euler(linear_solver: LinearSolver) -> None:
    """π² E I / (4 L²) within 0.5 %, by halving of an interval; plane, ν = 0.

    Compression and shear change it by the order of the critical strain,
    π² h² / (48 L²) = 0.05 %; quadratic elements of h / 2 bend to 0.1 %.
    """
    column = Column((40, 2), "quadratic", linear_solver=linear_solver)
    low, high = 0.9 * column.euler, 1.1 * column.euler
    while high - low > 1e-3 * column.euler:
        middle = (low + high) / 2
        column.solve(middle)
        low, high = (middle, high) if is_stable(column.problem) else (low, middle)
    assert low == pytest.approx(column.euler, rel=5e-3)
