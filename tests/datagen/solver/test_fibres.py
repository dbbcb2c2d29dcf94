"""Materials with fibres in finite elements: stresses of every cell, forces and tangents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import Mesh, distributed
from datagen.mesh.geometries import Box
from datagen.output.cell_stresses import CellStresses
from datagen.output.undeformed_stiffness import stiffness_of
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from shared_schema.materials import (
    HolzapfelGasserOgden,
    Material,
    MooneyRivlin,
    material_of,
)
from tests.shared_schema.materials.deformations import stress

Array = NDArray[np.float64]
ARTERY = HolzapfelGasserOgden(
    c10=100, k1=80, k2=0.8, kappa=0.1, bulk_modulus=3e3, fibres=((1.0, 0.0), (0.0, 1.0))
)
RUBBER = MooneyRivlin(c10=60, c01=25, bulk_modulus=3000)


def plane_mesh() -> Mesh:
    """The rectangle 2 × 1, of 4 × 2 squares, sheared."""
    raw = Box(lower=(0, 0), upper=(2, 1), elements=(4, 2)).raw_mesh()
    x = raw.coordinates @ np.array([[1.0, 0.1], [0.2, 1.0]]).T
    return distributed(RawMesh(x, raw.cells, raw.cell_type), MPI.COMM_SELF)


def directions(count: int, families: int, d: int) -> Array:
    vectors = np.random.default_rng(0).normal(size=(count, families, d))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=2, keepdims=True))


def deformed(mesh: Mesh, material: Material | list[Material], f: Array, **keys: object) -> Array:
    """P of every cell, (n_cells, 3, 3), when all boundary nodes move by (F − I) x."""
    x = mesh.coordinates
    d = x.shape[1]
    settings = SolverSettings(tolerance=1e-9)
    everywhere = np.ones_like(x, dtype=bool)
    nothing = np.empty(0, dtype=np.int64), np.empty((0, d))
    problem = EquilibriumProblem(
        mesh,
        material,
        np.zeros_like(everywhere),
        settings,
        moved=everywhere,
        **keys,  # type: ignore[arg-type]
    )
    u = x @ (f[:d, :d] - np.eye(d)).T
    assert solve_load_case(problem, *nothing, settings, displacement=u).solved
    several = [material] if isinstance(material, Material) else material
    parts = keys.get("parts")
    return np.asarray(CellStresses(problem, several, parts).fields()["first_piola"])  # type: ignore[arg-type]


SHEARED = np.array([[1.1, 0.2, 0.0], [-0.1, 0.95, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("element", ["linear", "incompressible"])
def test_stresses_of_every_cell(element: Element) -> None:
    """In plane strain, with other directions in each cell, against ∂W/∂F by jets."""
    mesh = plane_mesh()
    fibres = directions(len(mesh.cells), 2, 2)
    found = deformed(mesh, ARTERY, SHEARED, element=element, fibres=fibres)
    for p, families in zip(found, fibres, strict=True):
        expected = stress(ARTERY, SHEARED, [np.append(a, 0.0) for a in families])
        np.testing.assert_allclose(p, expected, rtol=1e-9, atol=1e-8)


def test_other_material_without_fibres() -> None:
    """Cells of rubber have rows of zeros, the others their own directions."""
    mesh = plane_mesh()
    parts = np.arange(8) % 2
    fibres = directions(8, 2, 2)
    fibres[parts == 1] = 0.0
    found = deformed(mesh, [ARTERY, RUBBER], SHEARED, parts=parts, fibres=fibres)
    for p, families, part in zip(found, fibres, parts, strict=True):
        along = [np.append(a, 0.0) for a in families]
        expected = stress(RUBBER, SHEARED) if part else stress(ARTERY, SHEARED, along)
        np.testing.assert_allclose(p, expected, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("element", ["linear", "incompressible"])
def test_forces_and_tangents_are_derivatives(element: Element) -> None:
    """By central differences, in a state that is not homogeneous."""
    mesh = plane_mesh()
    fibres = directions(len(mesh.cells), 2, 2)
    free = np.zeros(len(mesh.coordinates), dtype=bool)
    problem = EquilibriumProblem(
        mesh, ARTERY, free, SolverSettings(tolerance=1.0), element, fibres=fibres
    )
    random, step = np.random.default_rng(1), 1e-6
    state, direction = random.normal(scale=0.02, size=(2, len(problem.u.x.array)))
    energies, forces = [], []
    for sign in (1, -1):
        problem.u.x.array[:] = state + sign * step * direction
        energies.append(problem.energy())
        problem.out_of_balance()
        forces.append(problem.residual.array_r.copy())
    problem.u.x.array[:] = state
    problem.out_of_balance()
    work = float(problem.residual.array_r @ direction)
    assert work == pytest.approx((energies[0] - energies[1]) / (2 * step), rel=1e-6)
    difference = (forces[0] - forces[1]) / (2 * step)
    product = problem.tangent()[:, :] @ direction
    assert product == pytest.approx(difference, abs=1e-6 * np.abs(difference).max())


def test_stiffness_depends_on_the_direction() -> None:
    """A body and its fibres, both turned by a right angle, have the turned stiffness."""
    raw = Box(lower=(0, 0), upper=(1, 1), elements=(1, 1)).raw_mesh()
    both = [
        stiffness_of(raw, ARTERY, fibres=np.array([[a, a]])).data
        for a in (np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([-1.0, 0.0]))
    ]
    np.testing.assert_allclose(both[0], both[2], rtol=1e-12)
    assert not np.allclose(both[0], both[1], rtol=1e-3)
    np.testing.assert_allclose(np.sort(both[0]), np.sort(both[1]), rtol=1e-9)


def test_missing_directions() -> None:
    mesh = plane_mesh()
    free = np.zeros(len(mesh.coordinates), dtype=bool)
    with pytest.raises(InputError, match="every cell has 0 directions of fibres, expected 1"):
        EquilibriumProblem(mesh, ARTERY, free, SolverSettings())


def test_own_material_with_fibres(tmp_path: Path) -> None:
    """One that a user writes, equal to a shipped one: stresses of every cell."""
    (tmp_path / "own.py").write_text(
        "from shared_schema import OwnMaterial\n\n\n"
        "class Mine(OwnMaterial):\n"
        "    families = 1\n"
        "    stiffness: float\n\n"
        "    def energy(self, c, of):\n"
        "        first = c.j ** (-2 / 3) * c.i1 - 3\n"
        "        (a,) = c.fibres\n"
        "        strain = of.positive(c.j ** (-2 / 3) * a.stretch - 1)\n"
        "        return 100 * first + self.stiffness / 1.6 * (of.exp(0.8 * strain**2) - 1) "
        "+ 1500 * (c.j - 1) ** 2\n"
    )
    content = {"model": "own.py:Mine", "stiffness": 80.0, "fibres": [1, 0]}
    shipped = ARTERY.model_copy(update={"kappa": 0.0, "fibres": ((1.0, 0.0),)})
    mesh = plane_mesh()
    fibres = directions(len(mesh.cells), 1, 2)
    both = [
        deformed(mesh, material, SHEARED, fibres=fibres)
        for material in (material_of(content, tmp_path), shipped)
    ]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-9, atol=1e-9)
