"""Stresses of every kind of element."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed
from datagen.mesh.geometries import Box
from datagen.output.cell_stresses import CellStresses
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import NeoHookean

MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.49)
SETTINGS = SolverSettings(tolerance=1e-10)
KINDS: list[tuple[Element, str]] = [
    ("quadratic", "hexahedron"),
    ("quadratic", "tetra"),
    ("incompressible", "hexahedron"),
    ("incompressible", "tetra"),
]


def cube(cell_type: str, elements: int) -> RawMesh:
    """The unit cube."""
    raw = Box(lower=(0,) * 3, upper=(1,) * 3, elements=(elements,) * 3).raw_mesh()
    if cell_type == "hexahedron":
        return raw
    parts = [[0, a, b, 6] for a, b in ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))]
    return RawMesh(raw.coordinates, raw.cells[:, parts].reshape(-1, 4), "tetra")


@pytest.mark.parametrize(("element", "cell_type"), KINDS)
def test_uniaxial_tension(element: Element, cell_type: str) -> None:
    """σ = F/A, nothing across, and the energy of the body is the density times its volume."""
    raw = cube(cell_type, 2)
    x, moved = raw.coordinates, np.zeros(raw.coordinates.shape, dtype=bool)
    moved[:, 0] = x[:, 0] == 1
    problem = EquilibriumProblem(
        distributed(raw, MPI.COMM_SELF), MATERIAL, x == 0, SETTINGS, element, moved=moved
    )
    nothing = np.empty(0, dtype=np.int64), np.empty((0, 3))
    assert solve_load_case(problem, *nothing, SETTINGS, displacement=0.2 * moved).solved
    u = problem.displacement()
    across = 1 + u[x[:, 1] == 1, 1].mean()
    force = problem.reactions()[x[:, 0] == 1, 0].sum()
    fields = CellStresses(problem, [MATERIAL], None).fields()
    stress = np.diag([force / across**2, 0, 0])
    for found in fields["cauchy"]:
        assert found == pytest.approx(stress, abs=1e-6)
    assert fields["jacobian"] == pytest.approx(1.2 * across**2, rel=1e-8)
    assert fields["energy_density"] == pytest.approx(problem.energy(), rel=1e-8)


def test_dilation_is_that_of_the_cell() -> None:
    """Under any displacement, θ is the deformed over the undeformed volume of a cell."""
    raw = cube("hexahedron", 1)
    problem = EquilibriumProblem(
        distributed(raw, MPI.COMM_SELF),
        MATERIAL,
        raw.coordinates == 0,
        SETTINGS,
        "incompressible",
    )
    cells, u = CellStresses(problem, [MATERIAL], None), np.zeros((8, 3))
    for lifted in (0.1, 0.3):
        u[(raw.coordinates == 1).all(axis=1), 2] = lifted
        problem.set_displacement(u)
        assert cells.fields()["jacobian"] == pytest.approx(1 + lifted / 4, rel=1e-12)
