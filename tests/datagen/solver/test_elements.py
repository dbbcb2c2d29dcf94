"""Elements: patch tests, derivatives, Cook's membrane, and the bent beam of 100 x 20 x 16 mm."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from datagen.discretisation.element import ELEMENTS, Element
from datagen.discretisation.locking import SHORTFALL, locking_warning, shortfall
from datagen.mesh.distributed_mesh import Mesh, distributed
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.materials import NeoHookean
from tests.datagen.solver.cantilever import beam_tip, box, cook, cook_tip

BOXES = {2: ((2.0, 1.0), (4, 3)), 3: ((2.0, 1.0, 1.0), (3, 2, 2))}
ALL = [(element, d, simplices) for element in ELEMENTS for d in BOXES for simplices in (0, 1)]
IN_THE_PLANE = [case for case in ALL if case[1] == 2]
COOK = 6.9  # m, rise of the corner for ν = 0.4999 (Simo and Armero 1992)
BENT = {0.45: 28.4e-3, 0.49: 28.2e-3}  # m, by Taylor and Hood and by F-bar on fine meshes


def distorted(d: int, simplices: int) -> Mesh:
    """Mesh of a box whose inner nodes are moved at random."""
    upper, elements = BOXES[d]
    raw = box(upper, elements, bool(simplices))
    x = raw.coordinates
    inner = np.all((x > 1e-9) & (x < np.asarray(upper) - 1e-9), axis=1)
    moves = np.random.default_rng(3).uniform(-0.05, 0.05, x.shape)
    moved = RawMesh(np.where(inner[:, None], x + moves, x), raw.cells, raw.cell_type)
    return distributed(moved, MPI.COMM_SELF)


def problem_on(mesh: Mesh, element: Element, held: bool = True) -> EquilibriumProblem:
    """Neo-Hookean problem, ν = 0.45, held at x = 0 or nowhere."""
    material = NeoHookean(young_modulus=500, poisson_ratio=0.45)
    clamped = np.isclose(mesh.coordinates[:, 0], 0.0) & held
    return EquilibriumProblem(mesh, material, clamped, SolverSettings(), element)


@pytest.mark.parametrize(("element", "d", "simplices"), IN_THE_PLANE)
def test_patch_in_the_plane(element: Element, d: int, simplices: int) -> None:
    assert_patch(element, d, simplices)


@pytest.mark.slow
@pytest.mark.parametrize(("element", "d", "simplices"), [case for case in ALL if case[1] == 3])
def test_patch_in_space(element: Element, d: int, simplices: int) -> None:
    assert_patch(element, d, simplices)


def assert_patch(element: Element, d: int, simplices: int) -> None:
    """Assert that a body whose surface is deformed homogeneously is so everywhere.

    All corners of the surface are held at (F − I) x; the inner ones go there by themselves.
    """
    mesh = distorted(d, simplices)
    x = mesh.coordinates
    upper = np.asarray(BOXES[d][0])
    surface = np.any((x < 1e-9) | (x > upper - 1e-9), axis=1)
    material = NeoHookean(young_modulus=500, poisson_ratio=0.45)
    problem = EquilibriumProblem(mesh, material, surface, SolverSettings(), element)
    gradient = np.random.default_rng(5).uniform(-0.1, 0.1, (d, d))
    problem.set_displacement(x @ gradient.T)
    held = problem.u.x.array.copy()
    energy_density = homogeneous_energy(np.eye(d) + gradient, material)
    kept = problem.supports.held_dofs  # the supports hold what `hold` says instead of zero
    assert kept.size
    problem.set_load(np.array([0]), np.zeros((1, d)))
    for _ in range(8):  # Newton's method with these supports
        problem.out_of_balance()
        residual = problem.residual.array_r.copy()
        residual[kept] = 0.0
        if np.linalg.norm(residual) < 1e-10:
            break
        matrix = problem.tangent()
        step = np.linalg.solve(matrix[:, :], residual)
        problem.u.x.array[:] -= step
    assert np.abs(problem.u.x.array[kept] - held[kept]).max() == 0.0
    assert problem.displacement() == pytest.approx(x @ gradient.T, abs=1e-9)
    assert problem.energy() == pytest.approx(energy_density * np.prod(upper), rel=1e-9)


def homogeneous_energy(f: np.ndarray, material: NeoHookean) -> float:
    """W = μ/2 (I_c − 3 − 2 ln J) + λ/4 (J² − 1 − 2 ln J), with F₃₃ = 1 in the plane."""
    j = np.linalg.det(f)
    i_c = np.sum(f**2) + 3 - len(f)
    lam, mu = material.lame_lambda, material.lame_mu
    return float(mu / 2 * (i_c - 3 - 2 * np.log(j)) + lam / 4 * (j**2 - 1 - 2 * np.log(j)))


@pytest.mark.parametrize(("element", "d", "simplices"), IN_THE_PLANE)
def test_derivatives_in_the_plane(element: Element, d: int, simplices: int) -> None:
    assert_derivatives(element, d, simplices)


@pytest.mark.slow
@pytest.mark.parametrize(("element", "d", "simplices"), [case for case in ALL if case[1] == 3])
def test_derivatives_in_space(element: Element, d: int, simplices: int) -> None:
    assert_derivatives(element, d, simplices)


def assert_derivatives(element: Element, d: int, simplices: int) -> None:
    """Assert that forces and tangent are the derivatives of the energy, by central differences.

    The direction moves all unknowns: displacements between corners, dilations and pressures too.
    """
    problem = problem_on(distorted(d, simplices), element, held=False)
    random, step = np.random.default_rng(0), 1e-6
    size = len(problem.u.x.array)
    state, direction = random.normal(scale=0.02, size=(2, size))
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
    matrix = problem.tangent()[:, :]
    difference = (forces[0] - forces[1]) / (2 * step)
    assert matrix @ direction == pytest.approx(difference, abs=1e-6 * np.abs(difference).max())
    assert np.abs(matrix - matrix.T).max() < 1e-10 * np.abs(matrix).max()


@pytest.mark.parametrize("simplices", [False, True])
def test_cooks_membrane(simplices: bool) -> None:
    """Incompressible elements reach the published 6.9 m from below; linear ones are far away."""
    rises = [cook_tip(n, simplices, "incompressible", 0.4999) for n in (8, 16, 32)]
    changes = np.diff(rises)
    assert np.all(changes > 0)
    assert changes[1] < 0.6 * changes[0]
    assert rises[-1] == pytest.approx(COOK, rel=0.01)
    assert cook_tip(32, simplices, "linear", 0.4999) < 0.5 * COOK


@pytest.mark.parametrize("simplices", [False, True])
def test_all_elements_agree_where_none_locks(simplices: bool) -> None:
    """Cook's membrane with ν = 0.3 on a fine mesh: within 1 %, linear triangles within 3 %."""
    rises = {element: cook_tip(32, simplices, element, 0.3) for element in ELEMENTS}
    assert rises["quadratic"] == pytest.approx(rises["incompressible"], rel=0.005)
    linear = 0.03 if simplices else 0.01
    assert rises["linear"] == pytest.approx(rises["quadratic"], rel=linear)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "simplices", "cells_across", "ratio"),
    [
        ("incompressible", False, 4, 0.49),
        ("incompressible", True, 2, 0.49),
        ("quadratic", False, 3, 0.45),
        ("quadratic", True, 4, 0.49),
    ],
)
def test_bent_beam(element: Element, simplices: bool, cells_across: int, ratio: float) -> None:
    """The deflection of the end is within 2 % of that on fine meshes."""
    assert beam_tip(cells_across, simplices, element, ratio) == pytest.approx(BENT[ratio], rel=0.02)


@pytest.mark.parametrize("ratio", [0.49, 0.4999])
def test_few_iterations_where_the_volume_hardly_changes(ratio: float) -> None:
    """One load step, and as many iterations as a compressible body takes, or two more.

    With the tangent of the forces alone, 2 steps of 12 and 4 of 39 iterations are necessary.
    """
    compressible = cook(16, False, "incompressible", 0.3).report
    report = cook(16, False, "incompressible", ratio).report
    assert report.load_steps == 1
    assert report.newton_iterations <= compressible.newton_iterations + 2


@pytest.mark.slow
@pytest.mark.parametrize("ratio", BENT)
@pytest.mark.parametrize(("simplices", "cell_type"), [(False, "hexahedron"), (True, "tetra")])
def test_linear_elements_are_as_wrong_as_their_warning_says(
    simplices: bool, cell_type: str, ratio: float
) -> None:
    """4 cells across the beam; the warning's figure is right within 3 points."""
    missing = 1 - beam_tip(4, simplices, "linear", ratio) / BENT[ratio]
    assert missing == pytest.approx(shortfall(cell_type, ratio), abs=0.03)
    warning = locking_warning("linear", cell_type, ratio)
    assert warning is not None
    assert f"bends {shortfall(cell_type, ratio):.0%} too little" in warning
    assert missing > 0.05


def test_who_is_warned() -> None:
    """Linear elements above ν = 0.4, and nobody else; the figure grows with ν."""
    for cell_type in SHORTFALL:
        assert locking_warning("linear", cell_type, 0.4) is None
        assert locking_warning("quadratic", cell_type, 0.49) is None
        assert locking_warning("incompressible", cell_type, 0.49) is None
        assert locking_warning("linear", cell_type, 0.41) is not None
        figures = [shortfall(cell_type, ratio) for ratio in (0.41, 0.45, 0.49, 0.499)]
        assert figures == sorted(figures)
