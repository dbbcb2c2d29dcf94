"""Strain energies and materials against closed forms, and the beam of Land et al. 2015.

Guccione's muscle is bent by a pressure, as other programs have it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.optimize import brentq

from datagen.cases.body import make_body
from datagen.cases.case import read_case
from datagen.discretisation.element import Element
from datagen.mesh.distributed_mesh import distributed, make_mesh
from datagen.mesh.geometries import Box
from datagen.output.cell_stresses import CellStresses, reactions_of_supports
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.actuators import pressed
from shared_schema.common.errors import InputError
from shared_schema.materials import (
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    ShippedMaterial,
    StVenantKirchhoff,
    Volumetric,
    Yeoh,
)

Matrix = NDArray[np.float64]
ProblemMaker = Callable[..., EquilibriumProblem]
MATERIAL = NeoHookean(young_modulus=500, poisson_ratio=0.4)
GRADIENTS = {
    2: np.array([[0.21, -0.13], [0.34, 0.09]]),
    3: np.array([[0.21, -0.13, 0.05], [0.34, 0.09, -0.2], [0.1, 0.07, -0.15]]),
}
BOTH = pytest.mark.parametrize("volumetric", ["paper", "quadratic"])
Slope = Callable[[np.ndarray], np.ndarray]
NOTHING = np.empty(0, dtype=np.int64), np.empty((0, 3))
BEAM = {  # problem 1, in m and Pa: 10 × 1 × 1 mm with fibres along x, 4 Pa from below
    "name": "beam",
    "mesh": {"kind": "box", "lower": [0, 0, 0], "upper": [0.01, 0.001, 0.001]},
    "material": {
        "model": "guccione",
        "stiffness": 2000,
        "b_f": 8,
        "b_t": 2,
        "b_fs": 4,
        "bulk_modulus": 1.0e6,
        "fibres": [1, 0, 0],
    },
    "element": "incompressible",
    "supports": [{"x": 0}],
    "load": {"family": "pressure", "region": {"z": 0}, "range": [1, 4]},
    "dataset": {"samples": 1, "seed": 1},
}


def first_piola_kirchhoff(f: Matrix, lam: float, mu: float, volumetric: Volumetric) -> Matrix:
    """P = μ(F − F⁻ᵀ) + U'(J) J F⁻ᵀ, by hand: ∂I_c/∂F = 2F, ∂J/∂F = J F⁻ᵀ.

    paper: U' = λ/2 (J − 1/J), so U' J = λ/2 (J² − 1); quadratic: U' J = λ (J − 1) J.
    """
    j = np.linalg.det(f)
    inverse = np.linalg.inv(f).T
    pressure = lam / 2 * (j**2 - 1) if volumetric == "paper" else lam * (j - 1) * j
    stress: Matrix = mu * (f - inverse) + pressure * inverse
    return stress


def energy_density(f: Matrix, lam: float, mu: float, volumetric: Volumetric) -> float:
    """W = μ/2 (tr FᵀF − 3 − 2 ln J) + U(J), with F₃₃ = 1 in plane strain."""
    full = np.eye(3)
    full[: len(f), : len(f)] = f
    j = np.linalg.det(full)
    u = lam / 4 * (j**2 - 1 - 2 * np.log(j)) if volumetric == "paper" else lam / 2 * (j - 1) ** 2
    return float(mu / 2 * (np.trace(full.T @ full) - 3 - 2 * np.log(j)) + u)


def energy_of(problem: EquilibriumProblem, gradient: Matrix) -> float:
    """Strain energy per volume in the homogeneous state u = H X."""
    x = problem.mesh.coordinates
    problem.set_displacement(x @ gradient.T)
    return problem.energy() / float(np.prod(np.ptp(x, axis=0)))


@pytest.fixture(params=[(2.0, 1.0), (2.0, 1.0, 1.5)])
def element(request: pytest.FixtureRequest, make_problem: ProblemMaker) -> ProblemMaker:
    """Make a function that builds the problem of one element, in the plane and in space."""
    upper = request.param
    return lambda volumetric: make_problem((1,) * len(upper), upper, volumetric=volumetric)


@BOTH
def test_energy_of_a_homogeneous_state(element: ProblemMaker, volumetric: Volumetric) -> None:
    problem = element(volumetric)
    gradient = GRADIENTS[problem.dimension]
    f = np.eye(problem.dimension) + gradient
    expected = energy_density(f, MATERIAL.lame_lambda, MATERIAL.lame_mu, volumetric)
    assert energy_of(problem, gradient) == pytest.approx(expected, rel=1e-12)


@BOTH
def test_energy_derivative_is_the_stress(element: ProblemMaker, volumetric: Volumetric) -> None:
    """Central differences of W against the closed-form P, component by component."""
    problem = element(volumetric)
    d, step = problem.dimension, 1e-5
    gradient = GRADIENTS[d]
    f = np.eye(d) + gradient
    stress = first_piola_kirchhoff(f, MATERIAL.lame_lambda, MATERIAL.lame_mu, volumetric)
    differences = np.empty((d, d))
    for i, k in np.ndindex(d, d):
        change = np.zeros((d, d))
        change[i, k] = step
        upward, downward = (
            energy_of(problem, gradient + change),
            energy_of(problem, gradient - change),
        )
        differences[i, k] = (upward - downward) / (2 * step)
    assert differences == pytest.approx(stress, rel=1e-7, abs=1e-6)


@BOTH
def test_frame_indifference(make_problem: ProblemMaker, volumetric: Volumetric) -> None:
    """W(QF) = W(F) and f_int rotates with the body."""
    problem = make_problem((4, 3), volumetric=volumetric)
    x = problem.mesh.coordinates
    u = np.random.default_rng(2).normal(scale=0.03, size=x.shape)
    problem.set_displacement(u)
    energy, forces = problem.energy(), problem.reactions()
    c, s = np.cos(0.9), np.sin(0.9)
    rotation = np.array([[c, -s], [s, c]])
    problem.set_displacement((x + u) @ rotation.T - x)
    assert problem.energy() == pytest.approx(energy, rel=1e-12)
    assert problem.reactions() == pytest.approx(forces @ rotation.T, abs=1e-10)


def rubber(slope: Callable[[float], float], bulk: float) -> Slope:
    """∂W/∂λᵢ of W(Ī₁) + K/2 (J − 1)²: W' J^(-2/3) (2 λᵢ − 2/3 I₁/λᵢ) + K (J − 1) J/λᵢ."""

    def stresses(stretch: np.ndarray) -> np.ndarray:
        j, i1 = stretch.prod(), (stretch**2).sum()
        first = j ** (-2 / 3) * i1 - 3
        deviator = j ** (-2 / 3) * (2 * stretch - 2 / 3 * i1 / stretch)
        return np.asarray(slope(first) * deviator + bulk * (j - 1) * j / stretch)

    return stresses


def mooney_rivlin(stretch: np.ndarray) -> np.ndarray:
    """With c₁₀ = 60, c₀₁ = 25, K = 3000 Pa; ∂I₂/∂λᵢ = 2 λᵢ (I₁ − λᵢ²)."""
    j, i1 = stretch.prod(), (stretch**2).sum()
    i2 = (i1**2 - (stretch**4).sum()) / 2
    second = j ** (-4 / 3) * (2 * stretch * (i1 - stretch**2) - 4 / 3 * i2 / stretch)
    return np.asarray(rubber(lambda _: 60.0, 3000.0)(stretch) + 25.0 * second)


def neo_hookean(stretch: np.ndarray) -> np.ndarray:
    """μ (λᵢ − 1/λᵢ) + λ/2 (J² − 1)/λᵢ with E = 500 Pa, ν = 0.4."""
    mu, lam = 500 / 2.8, 200 / (1.4 * 0.2)
    return np.asarray(mu * (stretch - 1 / stretch) + lam / 2 * (stretch.prod() ** 2 - 1) / stretch)


def st_venant_kirchhoff(stretch: np.ndarray) -> np.ndarray:
    """λᵢ (λ tr E + 2 μ Eᵢ) with E = 500 Pa, ν = 0.4."""
    mu, lam = 500 / 2.8, 200 / (1.4 * 0.2)
    strain = (stretch**2 - 1) / 2
    return np.asarray(stretch * (lam * strain.sum() + 2 * mu * strain))


def eight_chains(first: float) -> float:
    """dW/dĪ₁ = μ Σ i aᵢ Ī₁^(i−1)/λₘ^(2i−2) with μ = 150 Pa, λₘ = 2, of Ī₁ − 3."""
    terms = zip((1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750), range(1, 6), strict=True)
    return 150 * sum(i * a * ((first + 3) / 4) ** (i - 1) for a, i in terms)


def ogden(*pairs: tuple[float, float]) -> Slope:
    """∂W/∂λᵢ = Σ μ (λ̄ᵢ^α − (λ̄₁^α + λ̄₂^α + λ̄₃^α)/3)/λᵢ + K (J − 1) J/λᵢ, K = 3000 Pa."""

    def stresses(stretch: np.ndarray) -> np.ndarray:
        j = stretch.prod()
        kirchhoff = np.full(3, 3000.0 * (j - 1) * j)
        for mu, alpha in pairs:
            powers = (j ** (-1 / 3) * stretch) ** alpha
            kirchhoff += mu * (powers - powers.mean())
        return np.asarray(kirchhoff / stretch)

    return stresses


MATERIALS: list[tuple[ShippedMaterial, Slope]] = [
    (NeoHookean(young_modulus=500, poisson_ratio=0.4), neo_hookean),
    (StVenantKirchhoff(young_modulus=500, poisson_ratio=0.4), st_venant_kirchhoff),
    (MooneyRivlin(c10=60, c01=25, bulk_modulus=3000), mooney_rivlin),
    (
        Yeoh(c10=80, c20=-3, c30=0.4, bulk_modulus=3000),
        rubber(lambda x: 80 - 6 * x + 1.2 * x**2, 3000.0),
    ),
    (
        Gent(shear_modulus=170, limit=8, bulk_modulus=3000),
        rubber(lambda x: 85 / (1 - x / 8), 3000.0),
    ),
    (
        ArrudaBoyce(shear_modulus=150, limit_stretch=2, bulk_modulus=3000),
        rubber(eight_chains, 3000.0),
    ),
    (
        Ogden(mu=(100.0, 5.0, -20.0), alpha=(2.0, 4.0, -2.0), bulk_modulus=3000),
        ogden((100.0, 2.0), (5.0, 4.0), (-20.0, -2.0)),
    ),
]
NAMES = [material.model for material, _ in MATERIALS]


def pulled(material: ShippedMaterial, stretch: float, elements: int = 1) -> EquilibriumProblem:
    """A unit cube on three sliding faces, pulled at its face x = 1."""
    box = Box(lower=(0, 0, 0), upper=(1, 1, 1), elements=(elements,) * 3)
    mesh = make_mesh(box, MPI.COMM_SELF)
    x = mesh.coordinates
    held = np.isclose(x, 0.0)
    moved = np.zeros_like(held)
    moved[:, 0] = np.isclose(x[:, 0], 1.0)
    settings = SolverSettings(tolerance=1e-10)
    problem = EquilibriumProblem(mesh, material, held, settings, moved=moved)
    displacement = np.where(moved, stretch - 1.0, 0.0)
    assert solve_load_case(problem, *NOTHING, settings, displacement=displacement).solved
    return problem


@pytest.mark.parametrize(("material", "stresses"), MATERIALS, ids=NAMES)
@pytest.mark.parametrize("stretch", [0.8, 1.7])
def test_uniaxial_stress(material: ShippedMaterial, stresses: Slope, stretch: float) -> None:
    """Lateral stretch from P₂ = 0, and the force P₁ of the grip on 1 m²; all fields from them."""

    def lateral(t: float) -> float:
        return float(stresses(np.array([stretch, t, t]))[1])

    t = brentq(lateral, 0.3, 1.5, xtol=1e-14)
    stretches = np.array([stretch, t, t])
    expected = stresses(stretches)[0]
    problem = pulled(material, stretch)
    u, x = problem.displacement(), problem.mesh.coordinates
    assert u == pytest.approx(x * (stretches - 1), abs=1e-9)
    force = problem.reactions()[:, 0] @ np.isclose(x[:, 0], 1.0)
    assert force == pytest.approx(expected, rel=1e-9)
    supports = reactions_of_supports(problem, np.isclose(x, 0.0)).sum(axis=0)
    assert supports == pytest.approx([-expected, 0, 0], abs=1e-7)

    fields = CellStresses(problem, [material], None).fields()
    assert fields["deformation_gradient"][0] == pytest.approx(np.diag(stretches), abs=1e-9)
    assert fields["first_piola"][0] == pytest.approx(np.diag([expected, 0, 0]), abs=1e-6)
    cauchy = expected / t**2  # force over the deformed area
    assert fields["cauchy"][0] == pytest.approx(np.diag([cauchy, 0, 0]), abs=1e-6)
    assert fields["von_mises"][0] == pytest.approx(abs(cauchy), rel=1e-8)
    assert fields["jacobian"][0] == pytest.approx(stretch * t**2, rel=1e-9)
    assert problem.energy() == pytest.approx(fields["energy_density"][0], rel=1e-9)


@pytest.mark.slow  # compiles kernels for half a minute
def test_ogdens_fractions() -> None:
    """An exponent that is no even number, the lateral faces free."""
    material = Ogden(mu=(200.0,), alpha=(1.3,), bulk_modulus=3000)
    test_uniaxial_stress(material, ogden((200.0, 1.3)), 1.7)


def test_softer_than_rest_is_refused() -> None:
    with pytest.raises(ValueError, match="shear modulus at rest is 0 Pa"):
        MooneyRivlin(c10=0, c01=0, bulk_modulus=1)


# --- several materials ----------------------------------------------------------------------------

BAR = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 0.5};
Rectangle(2) = {1, 0, 0, 2, 0.5};
Coherence;
Physical Surface("soft") = {1};
Physical Surface("stiff") = {2};
Mesh.MeshSizeMax = 0.3;
"""


def bar_case(folder: Path, **keys: Any) -> Path:
    (folder / "bar.geo").write_text(BAR)
    modulus = {"poisson_ratio": 0.0, "volumetric": "quadratic"}
    content = {
        "name": "bar",
        "mesh": {"kind": "file", "path": "bar.geo"},
        "material": [
            {"group": "stiff", "young_modulus": 900.0, **modulus},
            {"group": "soft", "young_modulus": 300.0, **modulus},
        ],
        "supports": [{"x": 0, "components": ["x"]}, {"y": 0, "components": ["y"]}],
        "load": {
            "family": "displacement",
            "region": {"x": 3},
            "range": [0.5, 1.5],
            "components": ["x"],
        },
        "dataset": {"samples": 3, "seed": 1},
    }
    path = folder / "bar.yaml"
    path.write_text(yaml.safe_dump(content | keys))
    return path


def test_two_materials_in_series(tmp_path: Path) -> None:
    """Without Poisson's effect both parts bear P = μ (λ − 1/λ), μ = E/2; lengths 1 and 2 m."""
    case = read_case(str(bar_case(tmp_path)))
    body = make_body(case, MPI.COMM_SELF)
    load = body.loads[0]
    assert load.displacement is not None
    drive = load.controls, load.displacement
    assert solve_load_case(body.problem, load.nodes, load.forces, case.solver, *drive).solved
    u, x = body.problem.displacement(), body.mesh.coordinates
    end = np.isclose(x[:, 0], 3.0)

    def stretch(p: float, mu: float) -> float:
        return float(p / mu + np.sqrt((p / mu) ** 2 + 4)) / 2

    moved = float(load.displacement[end, 0][0])
    p = brentq(lambda p: stretch(p, 150) + 2 * stretch(p, 450) - 3 - moved, 0.0, 1e4, xtol=1e-12)
    interface = np.isclose(x[:, 0], 1.0)
    assert u[interface, 0] == pytest.approx(stretch(p, 150) - 1, rel=1e-8)
    assert body.problem.reactions()[end, 0].sum() == pytest.approx(0.5 * p, rel=1e-8)
    fields = CellStresses(body.problem, case.materials, body.parts).fields()
    assert fields["first_piola"][:, 0, 0] == pytest.approx(p, rel=1e-7)
    nodes, forces, _ = body.loads.recorded(load, body.problem.grip())
    assert set(nodes) == set(np.flatnonzero(end))
    assert forces.sum(axis=0) == pytest.approx([0.5 * p, 0.0], rel=1e-8)


@pytest.mark.parametrize("element", ["linear", "quadratic"])
@pytest.mark.parametrize("kind", [NeoHookean, StVenantKirchhoff])
def test_materials_of_one_model_share_kernels(element: Element, kind: type[Any]) -> None:
    """Energy, forces and tangent are those of a kernel for every material; a part has no cell."""
    moduli = (100.0, 900.0, 5000.0)
    shared = [kind(young_modulus=e, poisson_ratio=0.1 * i) for i, e in enumerate(moduli)]
    another = MooneyRivlin(c10=1.0, c01=1.0, bulk_modulus=1.0)
    raw = Box(lower=(0.0, 0.0), upper=(3.0, 1.0), elements=(3, 2)).raw_mesh()
    parts = np.array([0, 1, 1, 0, 0, 1])
    found = []
    for materials in (shared, [*shared, another]):  # one model, and two
        mesh = distributed(raw, MPI.COMM_SELF)
        clamped = np.isclose(mesh.coordinates[:, 0], 0.0)
        of = mesh, materials, clamped, SolverSettings(), element, parts
        problem = EquilibriumProblem(*of)
        assert (problem.forms.moduli is None) == (len(materials) == 4)
        problem.set_displacement(0.1 * np.sin(mesh.coordinates))
        forces = problem.out_of_balance().array_r.copy()
        found.append((problem.energy(), forces, problem.tangent()[:, :]))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(other).max())


@pytest.mark.parametrize(
    ("material", "said"),
    [
        ([{"group": "core", "young_modulus": 1.0, "poisson_ratio": 0.1}], "no such group of cells"),
        ([{"group": "soft", "young_modulus": 1.0, "poisson_ratio": 0.1}], "cells have none"),
        ([{"young_modulus": 1.0, "poisson_ratio": 0.1}], "each with another 'group'"),
        ({"group": "soft", "young_modulus": 1.0, "poisson_ratio": 0.1}, "in a list of materials"),
        (
            [{"group": "soft", "young_modulus": -1, "poisson_ratio": 0}],
            "'material.0.young_modulus'",
        ),
    ],
)
def test_wrong_groups(tmp_path: Path, material: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        make_body(read_case(str(bar_case(tmp_path, material=material))), MPI.COMM_SELF)
    assert said in str(error.value)


@pytest.mark.slow  # compiles kernels for a minute
def test_deflection_of_the_beam() -> None:
    """Position of the middle of the upper edge of the end: z between 4.14 and 4.20 mm.

    These are the results of all programs in Land et al., Proc. R. Soc. A 471 (2015) 20150641,
    Figure 5. The body of this test is nearly incompressible: K = 500 C.
    """
    case = read_case({**BEAM, "mesh": {**BEAM["mesh"], "elements": [40, 4, 4]}})  # type: ignore[dict-item]
    body = make_body(case, MPI.COMM_SELF)
    load, settings = body.loads[0], case.solver
    pressure = pressed([4.0])
    assert solve_load_case(body.problem, load.nodes, load.forces, settings, pressure).solved
    u, x = body.problem.displacement(), body.mesh.coordinates
    end = np.isclose(x, [0.01, 0.0005, 0.001]).all(axis=1)
    ((_, y, z),) = 1e3 * (x + u)[end]
    assert y == pytest.approx(0.5, abs=1e-6)
    assert 4.14 < z < 4.20
