"""Method of the FEniCSx tutorials: dolfinx's NewtonSolver with a direct solve of every tangent."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
import ufl
from dolfinx.nls.petsc import NewtonSolver
from mpi4py import MPI
from petsc4py import PETSc

from datagen import Case
from datagen.cases import Body
from datagen.dolfinx_versions import NewtonSolverNonlinearProblem, functionspace
from datagen.solver import deformation_gradient, energy_density
from shared_schema import NeoHookean
from shared_schema.loads import LoadCase


class TutorialProblem(NewtonSolverNonlinearProblem):
    """dolfinx's own nonlinear problem, with nodal forces subtracted from its residual."""

    def __init__(self, case: Case, body: Body) -> None:
        domain = body.mesh.domain
        space = functionspace(domain, ("Lagrange", 1, (domain.geometry.dim,)))
        self.state = dolfinx.fem.Function(space)
        dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2})
        gradient = deformation_gradient(self.state)
        assert isinstance(case.material, NeoHookean)
        energy = energy_density(gradient, case.material, domain) * dx
        residual = ufl.derivative(energy, self.state)
        self._numbering = body.problem.numbering
        clamped = np.flatnonzero(body.clamped[self._numbering.node_of_block]).astype(np.int32)
        zero = np.zeros(body.mesh.coordinates.shape[1], dtype=PETSc.ScalarType)
        super().__init__(residual, self.state, [dolfinx.fem.dirichletbc(zero, clamped, space)])
        self.load: tuple[Any, Any] = (np.empty(0, dtype=int), np.empty(0))

    def F(self, x: Any, b: Any) -> None:  # noqa: N802, dolfinx's name
        """Assemble the residual and subtract the nodal forces."""
        super().F(x, b)
        dofs, values = self.load
        b.array_w[dofs] -= values

    def take(self, load: LoadCase) -> None:
        """Replace the nodal forces, and set the displacement to zero."""
        positions, blocks = self._numbering.owned_blocks(load.nodes)
        d = load.forces.shape[1]
        dofs = (blocks[:, None] * d + np.arange(d)).ravel()
        self.load = dofs, load.forces[positions].ravel()
        self.state.x.array[:] = 0.0


class LoggedTutorialProblem(TutorialProblem):
    """The same problem with its assemblies logged, as PETSc logs those of a SNES."""

    residual_event, tangent_event = "TutorialResidual", "TutorialTangent"

    def F(self, x: Any, b: Any) -> None:  # noqa: N802, dolfinx's name
        """Assemble the residual."""
        with PETSc.Log.Event(self.residual_event):
            super().F(x, b)

    def J(self, x: Any, A: Any) -> None:  # noqa: N802, N803, dolfinx's names
        """Assemble the tangent."""
        with PETSc.Log.Event(self.tangent_event):
            super().J(x, A)


def tutorial_solver(problem: TutorialProblem) -> NewtonSolver:
    """Make dolfinx's NewtonSolver, which stops on the residual's norm, with MUMPS."""
    solver = NewtonSolver(MPI.COMM_SELF, problem)
    solver.convergence_criterion = "residual"
    solver.atol, solver.rtol, solver.max_it = 1e-8, 1e-30, 15
    solver.error_on_nonconvergence = False
    ksp = solver.krylov_solver
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    return solver
