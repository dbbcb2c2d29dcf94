"""Equilibria of all elements are equilibria of the same equations in scikit-fem.

With s = (θ/J)^(1/d) and the stress P = ∂W/∂F at s F, the forces of Π(u, θ, p) are

    ∫ [s P + (p J − P:sF / d) F⁻ᵀ] : ∇v dV,   ∫ (P:sF / (d θ) − p) ψ dV,   ∫ (J − θ) ψ dV;

where J itself is the dilation, s = 1 and the bracket is P.
"""

from __future__ import annotations

from typing import Any

import meshio
import numpy as np
import pytest
import skfem
from mpi4py import MPI
from numpy.typing import NDArray
from skfem.helpers import ddot, det, grad, inv, transpose
from skfem.io.meshio import from_meshio

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import box

Vector = NDArray[np.float64]
MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.47)
LINEAR = {
    "triangle": skfem.ElementTriP1,
    "quad": skfem.ElementQuad1,
    "tetra": skfem.ElementTetP1,
    "hexahedron": skfem.ElementHex1,
}
QUADRATIC = {
    "triangle": skfem.ElementTriP2,
    "quad": skfem.ElementQuad2,
    "tetra": skfem.ElementTetP2,
    "hexahedron": skfem.ElementHex2,
}
BODIES = [(d, simplices) for d in (2, 3) for simplices in (False, True)]
CASES = [
    pytest.param(element, d, simplices, marks=[pytest.mark.slow] if d == 3 else [])
    for element in ("quadratic", "incompressible")
    for d, simplices in BODIES
]


def solved(element: Element, d: int, simplices: bool) -> tuple[EquilibriumProblem, Vector]:
    """Bend a beam with slanted cells by a force at a corner; the problem, and the forces."""
    elements = {2: (8, 3), 3: (5, 2, 2)}[d]
    raw = box((4.0, 1.0, 1.0)[:d], elements, simplices)
    x = raw.coordinates.copy()
    x[:, 0] += 0.1 * np.sin(np.pi * x[:, 1]) * np.sin(np.pi * x[:, 0] / 4)
    mesh = distributed(RawMesh(x, raw.cells, raw.cell_type), MPI.COMM_SELF)
    settings = SolverSettings(relative_tolerance=1e-12)
    problem = EquilibriumProblem(mesh, MATERIAL, np.isclose(x[:, 0], 0.0), settings, element)
    forces = np.zeros_like(x)
    corner = int(np.abs(x - np.array([4.0, 1.0, 1.0])[:d]).sum(axis=1).argmin())
    forces[corner, -2:] = 0.7, -1.5
    report = solve_load_case(problem, np.array([corner]), forces[[corner]], settings)
    assert report.solved
    assert np.linalg.norm(problem.displacement()[corner]) > 0.4
    return problem, forces


def stress(f: Any, material: NeoHookean) -> Any:
    """P = μ (F − F⁻ᵀ) + λ/2 (J² − 1) F⁻ᵀ."""
    back = transpose(inv(f))
    pressure = material.lame_lambda / 2 * (det(f) ** 2 - 1)
    return material.lame_mu * (f - back) + pressure * back


@pytest.mark.parametrize(("element", "d", "simplices"), CASES)
def test_in_equilibrium_by_scikit_fem(element: Element, d: int, simplices: bool) -> None:
    """No free degree of freedom is out of balance by more than 1e-9 N under 1.7 N."""
    problem, forces = solved(element, d, simplices)
    mesh, kind, unknowns = problem.mesh, problem.kind, problem.unknowns
    theirs = from_meshio(meshio.Mesh(mesh.coordinates, {mesh.cell_type: mesh.cells}))
    elements = QUADRATIC if kind.degree == 2 else LINEAR
    vectors = skfem.ElementVector(elements[mesh.cell_type]())
    basis = skfem.Basis(theirs, vectors, intorder=kind.quadrature_degree)
    state = problem.u.x.array

    points = unknowns.owned_points(mesh.coordinates)
    held, load, u = np.zeros(basis.N, dtype=bool), np.zeros(basis.N), np.zeros(basis.N)
    for dofs in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
        for component, of_component in enumerate(dofs):
            at = basis.doflocs[:, of_component].T
            distance = np.linalg.norm(at[:, None] - points[None], axis=2)
            assert distance.size == 0 or distance.min(axis=1).max() < 1e-12
            if distance.size:
                u[of_component] = state[unknowns.point_dofs[distance.argmin(axis=1), component]]
                held[of_component] = np.isclose(at[:, 0], 0.0)
    load[basis.nodal_dofs] = forces.T

    f = grad(basis.interpolate(u)) + np.eye(d)[:, :, None, None]
    j, back = det(f), transpose(inv(f))
    dx = basis.dx
    if kind.dilation == "pointwise":
        total = stress(f, MATERIAL)
    else:
        scalars = skfem.Basis(theirs, LINEAR[mesh.cell_type](), intorder=kind.quadrature_degree)
        if kind.dilation == "cell":
            theta = np.broadcast_to(((j * dx).sum(1) / dx.sum(1))[:, None], j.shape)
        else:
            theta, p = dilation_and_pressure(problem, scalars)
        f_bar = (theta / j) ** (1 / d) * f
        p_bar = stress(f_bar, MATERIAL)
        work = ddot(p_bar, f_bar) / d
        if kind.dilation == "cell":
            p = np.broadcast_to(((work / theta * dx).sum(1) / dx.sum(1))[:, None], j.shape)
        total = (theta / j) ** (1 / d) * p_bar + (p * j - work) * back
        if kind.dilation == "continuous":
            for value, scale in ((work / theta - p, 500.0), (j - theta, 1.0)):
                left = skfem.LinearForm(lambda v, w, value=value: value * v).assemble(scalars)
                assert np.abs(left).max() < 1e-9 * scale
    residual = skfem.LinearForm(lambda v, w: ddot(total, grad(v))).assemble(basis) - load
    assert np.abs(residual[~held]).max() < 1e-9
    assert np.linalg.norm(residual[held]) > 1.0  # the reactions


def dilation_and_pressure(problem: EquilibriumProblem, scalars: skfem.Basis) -> tuple[Any, Any]:
    """θ and p of a solution at the quadrature points, from their values at the corners.

    θ = 1 + t / h and p = (λ + 2 μ) q / h, with h the mean edge of the cells.
    """
    unknowns, mesh = problem.unknowns, problem.mesh
    d = problem.dimension
    corners = mesh.cells.shape[1]
    first = unknowns.cell_points.shape[1] * d
    corner_points = unknowns.cell_points[:, :corners]
    points = unknowns.owned_points(mesh.coordinates)
    edges = mesh.coordinates[mesh.cells[:, 1]] - mesh.coordinates[mesh.cells[:, 0]]
    size = np.linalg.norm(edges, axis=1).mean()
    fields = []
    for k in range(2):
        entries = unknowns.cell_dofs[:, first + k * corners : first + (k + 1) * corners]
        values = np.empty(len(mesh.coordinates))
        for points_of, dofs in zip(corner_points, entries, strict=True):
            for point, dof in zip(points_of, dofs, strict=True):
                node = np.linalg.norm(mesh.coordinates - points[point], axis=1).argmin()
                values[node] = problem.u.x.array[dof]
        fields.append(np.asarray(scalars.interpolate(values)) / size)
    t, q = fields
    return 1 + t, (MATERIAL.lame_lambda + 2 * MATERIAL.lame_mu) * q
