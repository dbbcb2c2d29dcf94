"""Equilibria by dolfinx 0.5 (https://fenicsproject.org), as its tutorial of hyperelasticity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import NonlinearProblem
from dolfinx.nls.petsc import NewtonSolver
from measured import measured
from mpi4py import MPI
from petsc4py import PETSc
from scipy.spatial import cKDTree

STEPS = 5


class Loaded(NonlinearProblem):
    """A problem beside forces at nodes."""

    force: Any

    def F(self, x: Any, b: Any) -> None:  # noqa: N802
        """Residual minus forces, which are zero at the supports."""
        super().F(x, b)
        b.axpy(-1.0, self.force)


def prepared(p: dict[str, Any]) -> Callable[..., Any]:
    """Return what solves one load."""
    d, kind = p["x"].shape[1], str(p["type"])
    names = {"quad": "quadrilateral", "tetra": "tetrahedron", "hexahedron": "hexahedron"}
    order = {"quad": [0, 1, 3, 2], "tetra": [0, 1, 2, 3], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}
    cell = ufl.Cell(names[kind], geometric_dimension=d)
    linear, constant = ufl.VectorElement("CG", cell, 1), ufl.FiniteElement("DG", cell, 0)
    domain = mesh.create_mesh(MPI.COMM_SELF, p["cells"][:, order[kind]], p["x"], ufl.Mesh(linear))
    mixed = "pressed" in p
    space = fem.FunctionSpace(
        domain, ufl.MixedElement([linear, constant, constant]) if mixed else linear
    )
    displacements, within = space.sub(0).collapse() if mixed else (space, None)
    place = cKDTree(p["x"]).query(displacements.tabulate_dof_coordinates()[:, :d])[1]
    rows = np.arange(d * len(place)) if within is None else np.array(within)
    found = fem.Function(space)
    u, pressure, theta = ufl.split(found) if mixed else (found, 0.0, 1.0)
    f = ufl.Identity(d) + ufl.grad(u)
    j, mu = ufl.det(f), p["young"] / 2 / (1 + p["poisson"])
    lam = 2 * mu * p["poisson"] / (1 - 2 * p["poisson"])
    c, volume = f.T * f, theta if mixed else j
    i1 = ufl.tr(c) * (volume / j) ** (2 / 3) if mixed else ufl.tr(c) + 3 - d
    energy = mu / 2 * (i1 - 3 - 2 * ufl.ln(volume))
    energy += lam / 4 * (volume**2 - 1 - 2 * ufl.ln(volume))
    if mixed:
        energy += pressure * (j - theta)
    dx = ufl.dx(metadata={"quadrature_degree": 2 if kind != "tetra" else 1})
    residual = ufl.derivative(energy * dx, found, ufl.TestFunction(space))
    blown = fem.Constant(domain, 0.0)
    if mixed:
        inside = cKDTree(p["x"][np.unique(p["pressed"])])
        facets = mesh.locate_entities_boundary(domain, 2, lambda x: inside.query(x.T)[0] < 1e-9)
        tags = mesh.meshtags(domain, 2, np.sort(facets), np.ones(len(facets), np.int32))
        ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata={"quadrature_degree": 2})
        normal = j * ufl.inv(f).T * ufl.FacetNormal(domain)
        residual += blown * ufl.inner(normal, ufl.split(ufl.TestFunction(space))[0]) * ds(1)
    zero, clamp = fem.Function(displacements), cKDTree(p["x"][p["held"].all(axis=1)])
    spaces = (space.sub(0), displacements) if mixed else space
    held = fem.locate_dofs_geometrical(spaces, lambda x: clamp.query(x[:d].T)[0] < 1e-9)
    support = fem.dirichletbc(zero, held, space.sub(0)) if mixed else fem.dirichletbc(zero, held)
    problem = Loaded(residual, found, [support])
    solver = NewtonSolver(MPI.COMM_SELF, problem)
    solver.convergence_criterion, solver.rtol, solver.max_it = "incremental", 1e-8, 30
    ksp = solver.krylov_solver
    options, prefix = PETSc.Options(), ksp.getOptionsPrefix()
    options[f"{prefix}ksp_type"], options[f"{prefix}pc_type"] = "preonly", "lu"
    options[f"{prefix}pc_factor_mat_solver_type"] = "mumps"
    ksp.setFromOptions()
    problem.force = found.vector.duplicate()

    def solve(force: Any, amount: float = 0.0) -> Any:
        found.x.array[:] = 0.0
        if mixed:
            found.sub(2).interpolate(lambda x: np.ones(x.shape[1]))
        for part in np.linspace(0, 1, STEPS + 1)[1:]:
            problem.force.array[rows] = part * force[place].ravel()
            blown.value = part * amount
            solver.solve(found)
        answer = np.empty_like(force)
        answer[place] = found.x.array[rows].reshape(-1, d)
        return answer

    return solve


measured(prepared)
