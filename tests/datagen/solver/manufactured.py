r"""Manufactured solutions: loads under which a body takes a displacement of closed form.

For a displacement :math:`u^*` of a body that is held at x = 0, where it vanishes, and the stress
:math:`P^* = ∂W/∂F` of :math:`F^* = I + ∇u^*`, UFL derives

.. math:: b = -\operatorname{div} P^* \quad \text{in the body}, \qquad
          t = P^* N \quad \text{on the rest of its surface}.

Under these forces the error of the finite elements falls with the size h of the cells: that of the
displacement as :math:`h^{k+1}`, that of its gradient as :math:`h^k` (P. J. Roache, *Verification of
Codes by the Method of Manufactured Solutions*, 2002; for hyperelastic codes K. I. Aycock, N. Rebelo
and B. A. Craven, 2020).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI

from datagen.discretisation.element import Element
from datagen.dolfinx_versions import COMPILER_OPTIONS, form
from datagen.mesh.distributed_mesh import distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from datagen.solver.strain_energy import deformation_gradient, energy_density
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import (
    Gent,
    MooneyRivlin,
    NeoHookean,
    ShippedMaterial,
    StVenantKirchhoff,
    Yeoh,
)
from tests.datagen.solver.cantilever import box

DEGREE = {2: 8, 3: 6}  # polynomials that integrals of loads and errors are exact for
NEARLY_INCOMPRESSIBLE = "neo_hookean, ν = 0.4999"
MATERIALS: dict[str, ShippedMaterial] = {  # moduli in Pa
    "neo_hookean": NeoHookean(young_modulus=500.0, poisson_ratio=0.3),
    "neo_hookean, quadratic": NeoHookean(
        young_modulus=500.0, poisson_ratio=0.3, volumetric="quadratic"
    ),
    NEARLY_INCOMPRESSIBLE: NeoHookean(young_modulus=500.0, poisson_ratio=0.4999),
    "st_venant_kirchhoff": StVenantKirchhoff(young_modulus=500.0, poisson_ratio=0.3),
    "mooney_rivlin": MooneyRivlin(c10=60.0, c01=25.0, bulk_modulus=400.0),
    "yeoh": Yeoh(c10=60.0, c20=20.0, c30=5.0, bulk_modulus=400.0),
    "gent": Gent(shear_modulus=120.0, limit=5.0, bulk_modulus=400.0),
}


@dataclass(frozen=True)
class Errors:
    """Errors on one mesh, relative to the norms of the solution.

    Attributes
    ----------
    cells : int
        Along an edge of the box.
    displacement, gradient : float
        ‖u − u*‖ / ‖u*‖ and ‖∇u − ∇u*‖ / ‖∇u*‖ in L².
    """

    cells: int
    displacement: float
    gradient: float


@dataclass(frozen=True)
class Convergence:
    """Errors on meshes from coarse to fine."""

    errors: tuple[Errors, ...]

    @property
    def rates(self) -> list[tuple[float, float]]:
        """Powers of the size of the cells that both errors fall with, from mesh to mesh."""
        found = []
        for coarse, fine in pairwise(self.errors):
            ratio = np.log(fine.cells / coarse.cells)
            of_displacement = np.log(coarse.displacement / fine.displacement) / ratio
            of_gradient = np.log(coarse.gradient / fine.gradient) / ratio
            found.append((float(of_displacement), float(of_gradient)))
        return found


def expected_rates(element: Element, simplices: bool) -> tuple[int, int]:
    """Powers k + 1 and k of an element of degree k."""
    degree = 1 if element == "linear" or (element == "incompressible" and not simplices) else 2
    return degree + 1, degree


def general(x: Any) -> Any:
    """A displacement whose volume changes; the body is under tension, so that it is stable."""
    if len(x) == 2:
        wave = [ufl.cos(2 * x[1]), ufl.sin(2 * x[0] + x[1])]
    else:
        wave = [ufl.cos(2 * x[1] + x[2]), ufl.sin(2 * x[0] + x[2]), ufl.cos(x[0] + 2 * x[1])]
    return 0.1 * x[0] * ufl.as_vector([2 + wave[0], *wave[1:]])


def isochoric(x: Any) -> Any:
    """A displacement that keeps the volume: a shear; in space also a torsion about (y, z) = 0."""
    shear = 0.3 * ufl.sin(2 * x[0])
    if len(x) == 2:
        return ufl.as_vector((0 * x[0], shear))
    angle = 0.6 * ufl.sin(x[0])
    cos, sin = ufl.cos(angle), ufl.sin(angle)
    turned = cos * x[1] - sin * x[2] - x[1], sin * x[1] + cos * x[2] - x[2]
    return ufl.as_vector((0 * x[0], turned[0] + shear, turned[1]))


def bent_box(d: int, cells: int, simplices: bool) -> RawMesh:
    """Box of 1 m with curved lines of nodes, so that no two cells are alike."""
    raw = box((1.0,) * d, (cells,) * d, simplices)
    x = raw.coordinates
    bump = 0.06 * np.prod(np.sin(np.pi * x), axis=1, keepdims=True)
    return RawMesh(x + bump * np.arange(1, d + 1) / d, raw.cells, raw.cell_type)


def measured(
    element: Element, d: int, simplices: bool, material: str, meshes: Sequence[int]
) -> Convergence:
    """Solve on meshes of so many cells along an edge; nearly incompressible bodies keep volume."""
    of = MATERIALS[material], material == NEARLY_INCOMPRESSIBLE
    return Convergence(tuple(errors(element, d, simplices, n, *of) for n in meshes))


Forces = tuple[np.ndarray, np.ndarray, tuple[()], None, np.ndarray | None]


def at_nodes_and_between(problem: EquilibriumProblem, forces: np.ndarray) -> Forces:
    """Load of a problem on one rank, for `set_load`, by the forces on its unknowns in N."""
    unknowns = problem.unknowns
    of_points = unknowns.point_numbering.gathered(problem.comm, forces[unknowns.point_dofs])
    nodes = np.arange(len(problem.mesh.coordinates))
    if unknowns.points is None:
        return nodes, of_points, (), None, None
    of_nodes, between = unknowns.points.on_nodes(of_points), of_points[len(nodes) :]
    return nodes, of_nodes, (), None, between


def errors(
    element: Element,
    d: int,
    simplices: bool,
    cells: int,
    material: ShippedMaterial,
    keeps_volume: bool,
) -> Errors:
    """Solve on one mesh, from the solution's values at its nodes."""
    mesh = distributed(bent_box(d, cells, simplices), MPI.COMM_SELF)
    clamped = np.isclose(mesh.coordinates[:, 0], 0.0)
    problem = EquilibriumProblem(mesh, material, clamped, SolverSettings(), element)
    domain, space = mesh.domain, problem.u.function_space
    x, of = ufl.SpatialCoordinate(domain), {"quadrature_degree": DEGREE[d]}
    dx, ds = (ufl.Measure(name, domain, metadata=of) for name in ("dx", "ds"))
    exact = (isochoric if keeps_volume else general)(x)
    u, v = problem.u, ufl.TestFunction(space)
    if problem.kind.has_pressure:
        u, v = ufl.split(problem.u)[0], ufl.split(v)[0]
    f = ufl.variable(deformation_gradient(exact))
    stress = ufl.diff(energy_density(f, material, domain), f)
    load = ufl.inner(-ufl.div(stress), v) * dx
    load += ufl.inner(stress * ufl.FacetNormal(domain), v) * ds  # no work where the body is held
    forces = dolfinx.fem.assemble_vector(form(load, COMPILER_OPTIONS)).array
    problem.set_load(*at_nodes_and_between(problem, forces))
    problem.set_displacement(values(exact, mesh.coordinates))
    result = problem.solve(1.0, direct=True)
    assert result.converged, result.explanation

    def norm(field: Any) -> float:
        squared = form(ufl.inner(field, field) * dx, COMPILER_OPTIONS)
        return float(np.sqrt(dolfinx.fem.assemble_scalar(squared)))

    found = Errors(
        cells,
        norm(u - exact) / norm(exact),
        norm(ufl.grad(u) - ufl.grad(exact)) / norm(ufl.grad(exact)),
    )
    problem.close()
    return found


def values(field: Any, points: Any) -> Any:
    """A displacement at points, (n, d)."""
    components = [field[i] for i in range(points.shape[1])]
    return np.array([[component(tuple(point)) for component in components] for point in points])
