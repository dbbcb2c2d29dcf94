"""The path of equilibria from rest as a power series, from which Newton's method begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import SolveReport, solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import box

SIZE, CELLS = (4.0, 1.0, 1.0), (8, 2, 2)
SOFT = NeoHookean(young_modulus=500.0, poisson_ratio=0.45)

Array = NDArray[np.float64]


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
        report = solve_load_case(self.problem, self.corner, forces, settings, pressures, moves)
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
    problem = EquilibriumProblem(mesh, SOFT, held, settings, element, moved=moved, surfaces=[below])
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
