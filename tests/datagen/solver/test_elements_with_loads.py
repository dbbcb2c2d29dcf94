"""Every element with every kind of material, support and load of a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.discretisation.element import ELEMENTS, Element
from datagen.mesh.distributed_mesh import Mesh, distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from datagen.solver.strain_energy import longitudinal_modulus
from shared_schema.actuators import pressed
from shared_schema.common.bodies.cells import outward_facets
from shared_schema.common.bodies.distributed_loads import pressure_forces
from shared_schema.common.bodies.following_loads import PressedSurface
from shared_schema.materials import (
    Material,
    MooneyRivlin,
    NeoHookean,
    ShippedMaterial,
    StVenantKirchhoff,
    material_of,
)
from tests.datagen.solver.cantilever import box
from tests.shared_schema.materials.deformations import stress

NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 2))
SOFT = NeoHookean(young_modulus=500, poisson_ratio=0.45)
STIFF = MooneyRivlin(model="mooney_rivlin", c10=200, c01=50, bulk_modulus=5000)
MATERIALS: tuple[ShippedMaterial, ...] = (
    STIFF,
    StVenantKirchhoff(model="st_venant_kirchhoff", young_modulus=500, poisson_ratio=0.3),
)
ALL = [(element, simplices) for element in ELEMENTS for simplices in (False, True)]


def beam(simplices: bool, elements: tuple[int, int] = (6, 3)) -> Mesh:
    return distributed(box((2.0, 1.0), elements, simplices), MPI.COMM_SELF)


def stretched(
    mesh: Mesh, material: Material, element: Element, settings: SolverSettings
) -> EquilibriumProblem:
    """A body between sliding faces, whose end is moved by 0.4 m along x."""
    x = mesh.coordinates
    held = np.isclose(x, 0.0)
    moved = np.zeros_like(held)
    moved[:, 0] = np.isclose(x[:, 0], 2.0)
    problem = EquilibriumProblem(mesh, material, held, settings, element, moved=moved)
    displacement = np.where(moved, 0.4, 0.0)
    assert solve_load_case(problem, *NOTHING, settings, displacement=displacement).solved
    return problem


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.model)
@pytest.mark.parametrize(("element", "simplices"), ALL)
def test_a_moved_end_stretches_every_element_alike(
    element: Element, simplices: bool, material: ShippedMaterial
) -> None:
    """Sliding supports and a prescribed displacement leave a homogeneous state to all elements."""
    x = beam(False).coordinates
    settings = SolverSettings()
    reference = stretched(beam(False), material, "linear", settings)
    problem = stretched(beam(simplices), material, element, settings)
    found = problem.displacement()
    assert found[:, 0] == pytest.approx(0.2 * x[:, 0], abs=1e-9)
    assert found == pytest.approx(reference.displacement(), abs=1e-8)
    grip = [p.reactions()[np.isclose(x[:, 0], 2.0), 0].sum() for p in (problem, reference)]
    assert grip[0] == pytest.approx(grip[1], rel=1e-6)


def force_of_layers(mesh: Mesh, element: Element, accuracy: float) -> float:
    """Force in N/m on the moved end of a beam of two layers without lateral strain."""
    x, settings = mesh.coordinates, SolverSettings()
    parts = (x[mesh.cells][..., 1].mean(axis=1) > 0.5).astype(np.int64)
    held = np.isclose(x, 0.0)
    held[:, 1] = True
    moved = np.zeros_like(held)
    moved[:, 0] = np.isclose(x[:, 0], 2.0)
    problem = EquilibriumProblem(mesh, (SOFT, STIFF), held, settings, element, parts, moved)
    displacement = np.where(moved, 0.4, 0.0)
    assert solve_load_case(problem, *NOTHING, settings, displacement=displacement).solved
    assert problem.displacement()[:, 0] == pytest.approx(0.2 * x[:, 0], abs=accuracy)
    return float(problem.reactions()[moved[:, 0], 0].sum())


@pytest.mark.parametrize(("element", "simplices"), ALL)
def test_layers_of_two_materials_stretch_side_by_side(element: Element, simplices: bool) -> None:
    """Forces of the layers add up: each bears P₁₁ = ∂W/∂λ₁ at the stretches (1.2, 1, 1).

    The pressures of Taylor and Hood are continuous over the interface, where those of the layers
    differ; the error falls as the mesh is refined.
    """
    f = np.diag([1.2, 1.0, 1.0])
    expected = (stress(SOFT, f)[0, 0] + stress(STIFF, f)[0, 0]) / 2
    smears = element == "incompressible" and simplices
    errors = []
    for elements in ((4, 2), (8, 4)) if smears else ((4, 2),):
        mesh = beam(simplices, elements)
        found = force_of_layers(mesh, element, 0.01 if smears else 1e-9)
        errors.append(abs(found / expected - 1))
    if smears:
        assert errors[1] < 0.7 * errors[0] < 0.02, errors
    else:
        assert errors[0] < 1e-8


def pressed_facets(mesh: Mesh) -> NDArray[np.int64]:
    x = mesh.coordinates
    facets = outward_facets(x, mesh.cells, mesh.cell_type)
    return np.asarray(facets[[bool((x[f, 1] == 1.0).all()) for f in facets]])


@pytest.mark.parametrize("linear_solver", ["lu", "corotated"])
@pytest.mark.parametrize(("element", "simplices"), ALL)
def test_pressure_that_follows_is_in_equilibrium(
    element: Element, simplices: bool, linear_solver: str
) -> None:
    """Supports bear the forces of the pressure on the deformed surface, by quadratic steps."""
    mesh = beam(simplices, (8, 4))
    settings = SolverSettings.model_validate({"linear_solver": linear_solver})
    held = np.repeat(np.isclose(mesh.coordinates[:, :1], 0.0), 2, axis=1)
    facets = pressed_facets(mesh)
    problem = EquilibriumProblem(
        mesh, SOFT, held, settings, element, following=[PressedSurface(facets)]
    )
    report = solve_load_case(problem, *NOTHING, settings, pressed([5.0]))
    assert report.solved
    assert report.cutbacks == 0
    u = problem.displacement()
    pushed = pressure_forces(mesh.coordinates + u, facets, 5.0)
    assert np.abs(u).max() > 0.1
    internal = problem.reactions() + pushed  # of the nodes, the corners
    assert internal.sum(axis=0) == pytest.approx(np.zeros(2), abs=1e-7)
    assert problem.reactions()[~held[:, 0]] == pytest.approx(0.0, abs=1e-7)


def test_modulus_of_an_own_material(tmp_path: Path) -> None:
    """λ + 2μ of the undeformed body, the scale of the pressures, from the energy."""
    (tmp_path / "own.py").write_text(
        "from shared_schema import OwnMaterial\n\n\n"
        "class Mine(OwnMaterial):\n"
        "    stiffness: float\n\n"
        "    def energy(self, c, of):\n"
        "        shear = (c.i1 - 3 - 2 * of.ln(c.j)) / 2\n"
        "        return self.stiffness * (shear + (c.j - 1) ** 2)\n"
    )
    material = material_of({"model": "own.py:Mine", "stiffness": 30.0}, tmp_path)
    assert longitudinal_modulus(material) == pytest.approx(4 * 30.0, rel=1e-12)  # μ = 30, λ = 60
    mesh = beam(True)
    found = stretched(mesh, material, "incompressible", SolverSettings())
    assert found.displacement()[:, 0] == pytest.approx(0.2 * mesh.coordinates[:, 0], abs=1e-9)
