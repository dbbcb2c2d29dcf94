"""Bodies for convergence studies of elements: a beam under end traction, and Cook's membrane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import Mesh, distributed
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.loads import LoadableNodes
from shared_schema.loads.distributed_forces import point_areas
from shared_schema.materials import NeoHookean
from shared_schema.samples.results import SolveReport

SIMPLICES = {  # of a quadrilateral and of a hexahedron
    2: ((0, 1, 2), (0, 2, 3)),
    3: ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)),
}
BEAM = (0.1, 0.02, 0.016)  # m: 100 x 20 x 16 mm
BEAM_MODULUS, BEAM_TRACTION = 5e5, -1e3  # Pa
COOK_MODULUS, COOK_TRACTION = 240.565, 6.25  # Pa: 100 N/m over a side of 16 m


def box(upper: tuple[float, ...], elements: tuple[int, ...], simplices: bool) -> RawMesh:
    """Mesh of a box; each quadrilateral or hexahedron is cut into simplices if wanted."""
    raw = Box(lower=(0.0,) * len(upper), upper=upper, elements=elements).raw_mesh()
    if not simplices:
        return raw
    corners = SIMPLICES[len(upper)]
    cells = np.concatenate([raw.cells[:, list(corner)] for corner in corners])
    return RawMesh(raw.coordinates, cells, {2: "triangle", 3: "tetra"}[len(upper)])


@dataclass(frozen=True)
class Bent:
    """A solved body.

    Attributes
    ----------
    problem : EquilibriumProblem
    report : SolveReport
    displacement : array, (n_nodes, d)
        In m.
    loaded : array of int
        Nodes of the loaded side.
    """

    problem: EquilibriumProblem
    report: SolveReport
    displacement: NDArray[np.float64]
    loaded: NDArray[np.int64]


def bent(
    mesh: Mesh,
    element: Element,
    material: NeoHookean,
    traction: tuple[float, ...],
    settings: SolverSettings,
) -> Bent:
    """Hold a body where x is least, and pull where it is largest by a traction in Pa."""
    x = mesh.coordinates
    loaded = np.flatnonzero(np.isclose(x[:, 0], x[:, 0].max()))
    areas = point_areas(LoadableNodes(loaded, x, mesh.cells, mesh.cell_type))[loaded]
    held = np.isclose(x[:, 0], x[:, 0].min())
    problem = EquilibriumProblem(mesh, material, held, settings, element)
    report = solve_load_case(problem, loaded, np.outer(areas, traction), settings)
    return Bent(problem, report, problem.displacement(), loaded)


def beam_tip(cells_across: int, simplices: bool, element: Element, poisson_ratio: float) -> float:
    """Mean deflection in m of the end of the beam of 100 x 20 x 16 mm under an end traction."""
    n = cells_across  # of the thickness
    elements = (round(25 * n / 4), round(5 * n / 4), n)
    mesh = distributed(box(BEAM, elements, simplices), MPI.COMM_SELF)
    material = NeoHookean(young_modulus=BEAM_MODULUS, poisson_ratio=poisson_ratio)
    traction = (0.0, 0.0, BEAM_TRACTION)
    found = bent(mesh, element, material, traction, SolverSettings())
    found.problem.close()
    assert found.report.solved
    return float(-found.displacement[found.loaded, 2].mean())


def cook(elements: int, simplices: bool, element: Element, poisson_ratio: float) -> Bent:
    """Cook's membrane.

    Its corners are (0, 0), (48, 44), (48, 60) and (0, 44). The left side is held, the right one
    sheared upwards by 100 N (Simo and Armero 1992).
    """
    square = box((1.0, 1.0), (elements, elements), simplices)
    x, y = square.coordinates.T
    points = np.stack([48 * x, 44 * x * (1 - y) + y * (44 + 16 * x)], axis=1)
    mesh = distributed(RawMesh(points, square.cells, square.cell_type), MPI.COMM_SELF)
    material = NeoHookean(young_modulus=COOK_MODULUS, poisson_ratio=poisson_ratio)
    found = bent(mesh, element, material, (0.0, COOK_TRACTION), SolverSettings())
    found.problem.close()
    assert found.report.solved
    return found


def cook_tip(elements: int, simplices: bool, element: Element, poisson_ratio: float) -> float:
    """Rise in m of the upper corner of Cook's membrane."""
    found = cook(elements, simplices, element, poisson_ratio)
    corner = np.hypot(*(found.problem.mesh.coordinates - (48.0, 60.0)).T).argmin()
    return float(found.displacement[corner, 1])
