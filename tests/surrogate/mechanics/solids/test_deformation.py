"""Materials in PyTorch: derivatives of their energies, and bodies of several."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from shared_schema.common.errors import InputError
from shared_schema.materials import (
    ArrudaBoyce,
    Gent,
    HolzapfelGasserOgden,
    Invariants,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    ShippedMaterial,
    StVenantKirchhoff,
    Yeoh,
    materials_of,
)
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.mechanics.equilibrium.stresses import cell_stresses, reactions
from surrogate.mechanics.solids.deformation import (
    completed,
    determinant,
    energy_density,
    stress,
)
from surrogate.mechanics.solids.solid import Solid
from tests.surrogate.mechanics.bodies import MATERIAL, box, end_load

MATERIALS: list[ShippedMaterial] = [
    MATERIAL,
    StVenantKirchhoff(young_modulus=500, poisson_ratio=0.4),
    MooneyRivlin(c10=60, c01=25, bulk_modulus=3000),
    Yeoh(c10=80, c20=-3, c30=0.4, bulk_modulus=3000),
    Gent(shear_modulus=170, limit=8, bulk_modulus=3000),
    Ogden(mu=(100.0, 2.0), alpha=(1.3, 4.0), bulk_modulus=3000),
    ArrudaBoyce(shear_modulus=150, limit_stretch=1.5, bulk_modulus=3000),
]
TORCH = SimpleNamespace(ln=torch.log, exp=torch.exp, positive=torch.relu)
ALL = pytest.mark.parametrize("material", MATERIALS, ids=lambda material: material.model)


def gradients(d: int) -> torch.Tensor:
    noise = np.random.default_rng(d).normal(size=(d, d, 7))
    return torch.from_numpy(0.15 * noise + np.eye(d)[:, :, None])


@ALL
@pytest.mark.parametrize("d", [2, 3])
def test_stress_is_the_derivative(material: ShippedMaterial, d: int) -> None:
    """Central differences of W, component by component."""
    f, h = gradients(d), 1e-6
    p = stress(f, material)
    for i, j in np.ndindex(d, d):
        change = torch.zeros(d, d, 1, dtype=torch.float64)
        change[i, j] = h
        by_energy = energy_density(f + change, material) - energy_density(f - change, material)
        torch.testing.assert_close(p[i, j], by_energy / (2 * h), rtol=1e-6, atol=1e-4)


def test_neo_hookean_energy_stands_once() -> None:
    """The formula of the schema is the closed form of the learner, in its plane and in space."""
    for volumetric in ("paper", "quadratic"):
        material = NeoHookean(young_modulus=500, poisson_ratio=0.4, volumetric=volumetric)
        for d in (2, 3):
            f = gradients(d)
            full = completed(f)
            c = torch.einsum("ki...,kj...->ij...", full, full)
            i1, j = full.square().sum((0, 1)), determinant(f)
            i2 = (i1.square() - c.square().sum((0, 1))) / 2
            expected = material.energy(Invariants(i1, i2, j), TORCH)
            torch.testing.assert_close(energy_density(f, material), expected, rtol=1e-12, atol=1e-9)


def test_energy_of_a_uniform_stretch() -> None:
    """F = 1.1 I in space: J = 1.331, I_c = 3.63; the energies are those of the formulas by hand."""
    f, lam, mu = 1.1 * torch.eye(3, dtype=torch.float64)[..., None], 5000 / 7, 1250 / 7
    isochoric = mu / 2 * (0.63 - 2 * math.log(1.331))
    volumes = {
        "paper": lam / 4 * (1.331**2 - 1 - 2 * math.log(1.331)),
        "quadratic": lam / 2 * 0.331**2,
    }
    for volumetric in ("paper", "quadratic"):
        material = NeoHookean(young_modulus=500, poisson_ratio=0.4, volumetric=volumetric)
        expected = isochoric + volumes[volumetric]
        assert energy_density(f, material).item() == pytest.approx(expected)


@ALL
def test_no_energy_without_a_body(material: ShippedMaterial) -> None:
    """+∞ where J ≤ 0, and beyond the limit of Gent's chains: Ī₁ − 3 = 16/2^(4/3)·… > 8."""
    turned = torch.diag(torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64))[:, :, None]
    assert energy_density(turned, material).item() == math.inf
    stretched = torch.diag(torch.tensor([6.0, 1.0, 1.0], dtype=torch.float64))[:, :, None]
    is_gent = isinstance(material, Gent)  # 6^(-2/3) · 38 − 3 = 8.5
    assert math.isinf(energy_density(stretched, material).item()) == is_gent


@ALL
@pytest.mark.parametrize("cell_type", ["triangle", "hexahedron"])
def test_tangents_of_cells(cell_type: str, material: ShippedMaterial) -> None:
    """K v is the derivative of the internal forces along v, and f that of the energy."""
    geometry = box(cell_type)
    solid = Solid(geometry.coordinates, geometry.cells, cell_type, material)
    shape, rng, h = geometry.coordinates.shape, np.random.default_rng(1), 1e-6
    u, v = (torch.from_numpy(0.02 * rng.normal(size=(1, *shape))) for _ in range(2))
    upward, downward = (solid.internal_forces(u + sign * h * v) for sign in (1, -1))
    dofs = v[:, solid.cells].flatten(2)
    products = torch.einsum("ncij,ncj->nci", solid.compiled.cell_tangents(u.numpy()), dofs)
    found = torch.zeros_like(u)
    found.index_add_(1, solid.cells.flatten(), products.reshape(1, -1, shape[1]))
    torch.testing.assert_close(found, (upward - downward) / (2 * h), rtol=1e-6, atol=1e-5)
    work = (solid.internal_forces(u) * v).sum()
    energies = [solid.energy(u + sign * h * v) for sign in (1, -1)]
    torch.testing.assert_close(
        work, ((energies[0] - energies[1]) / (2 * h))[0], rtol=1e-6, atol=1e-7
    )
    require_same_at_rest(solid)


def require_same_at_rest(solid: Solid) -> None:
    """K(0) of cells by PyTorch is that of the compiled loops, to rounding."""
    rest = np.zeros((1, solid.nodes, solid.gradients.shape[3]))
    expected, found = solid.compiled.cell_tangents(rest), solid.stiffness_at_rest()
    scale = float(expected.abs().max())
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12 * scale)


def test_two_materials_are_those_of_their_cells() -> None:
    geometry = box("quad")
    parts = (np.arange(len(geometry.cells)) % 3 == 0).astype(np.int64)
    pair = MATERIALS[2], MATERIALS[0]
    mesh = geometry.coordinates, geometry.cells, "quad"
    u = torch.from_numpy(0.02 * np.random.default_rng(0).normal(size=(2, 28, 2)))
    both = Solid(*mesh, pair, parts)
    alone = [Solid(*mesh, material) for material in pair]
    tangents = [solid.compiled.cell_tangents(u.numpy()) for solid in alone]
    chosen = torch.from_numpy(parts)[None, :, None, None]
    expected = torch.where(chosen == 0, tangents[0], tangents[1])
    torch.testing.assert_close(
        both.compiled.cell_tangents(u.numpy()), expected, rtol=1e-10, atol=1e-9
    )
    require_same_at_rest(both)
    of_cells = [
        Solid(geometry.coordinates, geometry.cells[parts == i], "quad", material).energy(u)
        for i, material in enumerate(pair)
    ]
    torch.testing.assert_close(both.energy(u), of_cells[0] + of_cells[1], rtol=1e-12, atol=0)


def test_single_components_slide() -> None:
    """A bar on rollers, pulled: equilibrium by Newton's method, K⁻¹ f, and reactions.

    One node is held in both components. The resultant of the reactions is minus the load, and no
    force is needed along the rollers.
    """
    geometry = box("quad")
    x = geometry.coordinates
    held = np.zeros(x.shape, dtype=bool)
    held[x[:, 0] == 0, 0] = True
    held[0] = True
    geometry = replace(geometry, clamped=np.asarray(held.all(axis=1)), single=held)
    forces = end_load(geometry, 3.0, 1.0)
    equilibrium = Equilibrium(geometry, MATERIALS[3])
    u = correct(equilibrium, forces, np.zeros_like(forces)).displacement
    assert not u[held].any()
    assert np.ptp(u[x[:, 0] == 0, 1]) > 1e-3
    bearing = reactions(equilibrium.solid, geometry, u[None], np.zeros((1, *u.shape)))[0]
    np.testing.assert_allclose(bearing.sum(axis=0), [-3.0, -1.0], atol=1e-8)

    linear = equilibrium.linear_response(1e-6 * forces[None])[0]
    small = correct(equilibrium, 1e-6 * forces, linear, tolerance=1e-11).displacement
    np.testing.assert_allclose(linear, small, rtol=1e-4, atol=1e-5 * np.abs(small).max())
    found = Compliance(geometry, MATERIALS[3])(torch.from_numpy(1e-6 * forces)[None].float())[0]
    np.testing.assert_allclose(found.numpy(), linear, atol=1e-5 * np.abs(linear).max())


@ALL
def test_uniform_stretch_has_one_stress(material: ShippedMaterial) -> None:
    """All cells have the F and P of u = (F − I) x; σ = P Fᵀ/J and von Mises by hand."""
    geometry = box("hexahedron")
    f = np.array([[1.2, 0.1, 0.0], [0.05, 0.9, 0.0], [0.0, -0.1, 1.0]])
    solid = Solid(geometry.coordinates, geometry.cells, "hexahedron", material)
    fields = cell_stresses(solid, geometry, (geometry.coordinates @ (f - np.eye(3)).T)[None])
    p = stress(torch.from_numpy(f)[:, :, None], material)[..., 0].numpy()
    s = p @ f.T / np.linalg.det(f)
    pairs = ((0, 1), (1, 2), (2, 0))
    expected = np.sqrt(
        sum((s[i, i] - s[j, j]) ** 2 for i, j in pairs) / 2
        + 3 * sum(s[i, j] ** 2 for i, j in pairs)
    )
    cells = len(geometry.cells)
    assert fields["first_piola"].shape == (1, cells, 3, 3)
    np.testing.assert_allclose(
        fields["deformation_gradient"][0], np.tile(f, (cells, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(fields["von_mises"][0], expected, rtol=1e-10)
    np.testing.assert_allclose(s, s.T, atol=1e-9)  # no couple


@pytest.mark.parametrize("d", [2, 3])
def test_fibres(d: int) -> None:
    """Central differences of W and P of two families; without directions it is an error."""
    artery = HolzapfelGasserOgden(
        c10=60, k1=90, k2=2, kappa=0.1, bulk_modulus=300, fibres=((0.8, 0.6), (1.0, 0.0))
    )
    geometry = box("quad" if d == 2 else "hexahedron")
    mesh = geometry.coordinates, geometry.cells, geometry.cell_type
    with pytest.raises(ValueError, match="has fibres, whose directions are missing"):
        Solid(*mesh, artery)
    noise = np.random.default_rng(0).normal(size=(len(geometry.cells), 2, d))
    solid = Solid(*mesh, artery, fibres=noise / np.linalg.norm(noise, axis=2, keepdims=True))
    u, v = (
        torch.from_numpy(0.02 * np.random.default_rng(i).normal(size=(1, *mesh[0].shape)))
        for i in (1, 2)
    )
    h = 1e-6
    work = (solid.internal_forces(u) * v).sum()
    energies = [solid.energy(u + sign * h * v) for sign in (1, -1)]
    torch.testing.assert_close(work, ((energies[0] - energies[1]) / (2 * h))[0], rtol=1e-6, atol=0)
    found = torch.zeros_like(u)
    dofs = v[:, solid.cells].flatten(2)
    products = torch.einsum("ncij,ncj->nci", solid.compiled.cell_tangents(u.numpy()), dofs)
    found.index_add_(1, solid.cells.flatten(), products.reshape(1, -1, d))
    upward, downward = (solid.internal_forces(u + sign * h * v) for sign in (1, -1))
    torch.testing.assert_close(found, (upward - downward) / (2 * h), rtol=1e-5, atol=1e-5)
    require_same_at_rest(solid)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"model": "gel.py:Gel"}, "'gel.py:Gel': the dataset is of an earlier version"),
        ([{"model": "yeoh", "c10": 1.0}], "'bulk_modulus' is missing"),
        (None, "expected a mapping"),
    ],
)
def test_unknown_materials(content: object, said: str) -> None:
    with pytest.raises(InputError, match="material of the case: ") as error:
        materials_of(content, "material of the case")
    assert said in str(error.value)
