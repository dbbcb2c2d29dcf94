"""Slender columns of every element, clamped at x = 0 and compressed along their axis."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import SolveReport, solve_load_case
from datagen.solver.settings import LinearSolver, SolverSettings
from shared_schema.loads import LoadableNodes
from shared_schema.loads.distributed_forces import point_areas
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import box

MODULUS = 500.0  # Pa
LENGTH, HEIGHT = 10.0, 0.5  # m


class Column:
    """A column whose end is under a compressive dead force.

    Parameters
    ----------
    elements : tuple of d ints
        Cells along every axis.
    element, simplices, linear_solver, ratio
        Kind of the elements and the solver; Poisson's ratio.
    """

    def __init__(
        self,
        elements: tuple[int, ...],
        element: Element = "linear",
        simplices: bool = False,
        linear_solver: LinearSolver = "lu",
        ratio: float = 0.0,
    ) -> None:
        upper = (LENGTH, *[HEIGHT] * (len(elements) - 1))
        mesh = distributed(box(upper, elements, simplices), MPI.COMM_SELF)
        self.x = mesh.coordinates
        self.end = np.flatnonzero(np.isclose(self.x[:, 0], LENGTH))
        self.areas = point_areas(LoadableNodes(self.end, self.x, mesh.cells, mesh.cell_type))[
            self.end
        ]
        self.settings = SolverSettings(linear_solver=linear_solver, first_step=0.5)
        material = NeoHookean(young_modulus=MODULUS, poisson_ratio=ratio)
        clamped = np.isclose(self.x[:, 0], 0.0)
        self.problem = EquilibriumProblem(mesh, material, clamped, self.settings, element)

    @property
    def euler(self) -> float:
        """π² E I / (4 L²) in N, with I = A h² / 12 (in the plane the body is 1 m thick)."""
        inertia = self.areas.sum() * HEIGHT**2 / 12
        return float(np.pi**2 * MODULUS * inertia / (4 * LENGTH**2))

    def solve(self, force: float) -> SolveReport:
        """Compress the column from rest by a force in N, spread evenly over its end."""
        forces = np.zeros((len(self.end), self.x.shape[1]))
        forces[:, 0] = -force * self.areas / self.areas.sum()
        report = solve_load_case(self.problem, self.end, forces, self.settings)
        assert report.solved
        return report

    def end_displacement(self) -> NDArray[np.float64]:
        """Mean displacement of the end in m."""
        mean: NDArray[np.float64] = self.problem.displacement()[self.end].mean(axis=0)
        return mean
