"""Pressures that follow the surface: their derivative, and bodies under pressure all around."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

from datagen.mesh.distributed_mesh import distributed, make_mesh
from datagen.mesh.geometries import Box
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.distributed_loads import (
    area_vectors,
    facet_derivatives,
    pressure_forces,
)
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import MooneyRivlin

MATERIAL = MooneyRivlin(c10=60, c01=25, bulk_modulus=300)
FACETS = {  # corners of one facet in space or in the plane
    "edge": np.array([[0.0, 0.1], [1.0, 0.4]]),
    "triangle": np.array([[0.0, 0.0, 0.1], [1.0, 0.2, 0.0], [0.1, 0.9, 0.3]]),
    "quadrilateral": np.array([[0, 0, 0.1], [1, 0.2, 0], [1.1, 0.9, 0.3], [0, 1, 0.0]]),
}


@pytest.mark.parametrize("kind", sorted(FACETS))
def test_derivative(kind: str) -> None:
    """Central differences of the nodal forces of one facet, entry by entry."""
    positions = FACETS[kind]
    facets = np.arange(len(positions))[None]
    found = facet_derivatives(positions, facets, 3.0)[0]
    h, expected = 1e-6, np.empty_like(found)
    for column, (node, axis) in enumerate(np.ndindex(positions.shape)):
        change = np.zeros_like(positions)
        change[node, axis] = h
        upward = pressure_forces(positions + change, facets, 3.0)
        downward = pressure_forces(positions - change, facets, 3.0)
        expected[:, column] = ((upward - downward) / (2 * h)).ravel()
    assert found == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("elements", [(3, 2), (3, 2, 2)])
def test_closed_surface_has_no_resultant(elements: tuple[int, ...]) -> None:
    """∮ n dS = 0 and ∮ x · n dS = d V, whatever the direction in which cells are numbered."""
    upper = (2.0, 1.0, 1.5)[: len(elements)]
    mesh = make_mesh(Box(lower=(0,) * len(elements), upper=upper, elements=elements), MPI.COMM_SELF)
    cells = mesh.cells.copy()
    turned = [0, 3, 2, 1] if len(elements) == 2 else [4, 5, 6, 7, 0, 1, 2, 3]
    cells[::2] = cells[::2][:, turned]
    facets = outward_facets(mesh.coordinates, cells, mesh.cell_type)
    areas = area_vectors(mesh.coordinates, facets)
    assert areas.sum(axis=0) == pytest.approx(0, abs=1e-12)
    volume = (areas * mesh.coordinates).sum()
    assert volume == pytest.approx(len(elements) * np.prod(upper), rel=1e-12)


@pytest.mark.parametrize("simplices", [False, True], ids=["bricks", "simplices"])
@pytest.mark.parametrize("d", [2, 3])
def test_pressure_all_around(d: int, simplices: bool) -> None:
    """A homogeneous state: Cauchy stress −p in the pressed directions, so P = −p J / λ.

    In space that is K (J − 1) = −p. In the plane λ₃ = 1, and P = ∂W/∂λ₁ of `MooneyRivlin` with
    ∂Ī₁/∂λ = J^(-2/3) (2 λ − 2/3 I₁/λ), ∂Ī₂/∂λ = J^(-4/3) (2 λ (I₁ − λ²) − 4/3 I₂/λ).
    """
    p, k = 120.0, MATERIAL.bulk_modulus

    def balance(t: float) -> float:
        stretch = np.array([t, t, t if d == 3 else 1.0])
        j, i1 = stretch.prod(), (stretch**2).sum()
        i2 = (i1**2 - (stretch**4).sum()) / 2
        first = j ** (-2 / 3) * (2 * t - 2 / 3 * i1 / t)
        second = j ** (-4 / 3) * (2 * t * (i1 - t**2) - 4 / 3 * i2 / t)
        return float(60 * first + 25 * second + k * (j - 1) * j / t + p * j / t)

    box = Box(lower=(0,) * d, upper=(1,) * d, elements=(2,) * d)
    raw = box.raw_mesh()
    if simplices:
        parts = [[0, 1, 2], [0, 2, 3]]
        if d == 3:
            parts = [[0, a, b, 6] for a, b in ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))]
        cells = raw.cells[:, parts].reshape(-1, d + 1)
        raw = RawMesh(raw.coordinates, cells, "triangle" if d == 2 else "tetra")
    x = raw.coordinates
    facets = outward_facets(x, raw.cells, raw.cell_type)
    pressed = facets[[(x[f] == 1).all(axis=0).any() for f in facets]]
    settings = SolverSettings(tolerance=1e-10)
    mesh = distributed(raw, MPI.COMM_SELF)
    problem = EquilibriumProblem(mesh, MATERIAL, x == 0, settings, surfaces=[pressed])
    nothing = np.empty(0, dtype=np.int64), np.empty((0, d))
    report = solve_load_case(problem, *nothing, settings, np.array([p]))
    assert report.solved
    stretch = brentq(balance, 0.3, 1.0, xtol=1e-14)
    if d == 3:
        assert k * (stretch**3 - 1) == pytest.approx(-p, rel=1e-9)
    assert problem.displacement() == pytest.approx(x * (stretch - 1), abs=1e-9)
    assert report.newton_iterations <= 8  # quadratic: the tangent holds the derivative
