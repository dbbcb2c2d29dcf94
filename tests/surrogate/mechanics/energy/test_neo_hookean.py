"""The material against closed forms, and its derivatives against automatic differentiation."""

from __future__ import annotations

import math

import pytest
import torch

from shared_schema.materials import NeoHookean, Volumetric
from surrogate.mechanics.solids.deformation import (
    cofactors,
    determinant,
    energy_density,
    moduli,
    stress,
)

VOLUMETRIC: list[Volumetric] = ["paper", "quadratic"]
LAM, MU = 5000 / 7, 1250 / 7  # of E = 500 Pa and ν = 0.4: λ = Eν/(0.28), μ = E/2.8


def material(volumetric: Volumetric) -> NeoHookean:
    return NeoHookean(young_modulus=500, poisson_ratio=0.4, volumetric=volumetric)


def moved(f: torch.Tensor, h: torch.Tensor, volumetric: Volumetric) -> torch.Tensor:
    """What of ∂P/∂F : H is of the volume."""
    j, g = determinant(f), cofactors(f) / determinant(f)
    first = {"paper": LAM / 2 * (j**2 - 1), "quadratic": LAM * j * (j - 1)}[volumetric]
    second = {"paper": LAM * j**2, "quadratic": LAM * j * (2 * j - 1)}[volumetric]
    turned = torch.einsum("ilp,klp,kjp->ijp", g, h, g)
    return (MU - first) * turned + second * (g * h).sum((0, 1)) * g


def gradients(d: int) -> torch.Tensor:
    """Five deformation gradients, (d, d, 5)."""
    noise = torch.randn(5, d, d, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    return (torch.eye(d) + 0.2 * noise).permute(1, 2, 0)


@pytest.mark.parametrize("d", [2, 3])
def test_determinant_and_inverse(d: int) -> None:
    f = gradients(d)
    matrices = f.permute(2, 0, 1)
    j = determinant(f)
    torch.testing.assert_close(j, torch.linalg.det(matrices))
    expected = torch.linalg.inv(matrices).mT.permute(1, 2, 0)
    torch.testing.assert_close(cofactors(f) / j, expected)


def test_uniform_stretch() -> None:
    """F = 1.1 I in space: J = 1.331, I_c = 3.63; the energies are those of the formulas by hand."""
    f = 1.1 * torch.eye(3, dtype=torch.float64)[..., None]
    isochoric = MU / 2 * (0.63 - 2 * math.log(1.331))
    paper = LAM / 4 * (1.331**2 - 1 - 2 * math.log(1.331))
    assert energy_density(f, material("paper")).item() == pytest.approx(isochoric + paper)
    quadratic = LAM / 2 * 0.331**2
    assert energy_density(f, material("quadratic")).item() == pytest.approx(isochoric + quadratic)


@pytest.mark.parametrize("volumetric", VOLUMETRIC)
@pytest.mark.parametrize("d", [2, 3])
def test_stress_is_the_derivative_of_the_energy(d: int, volumetric: Volumetric) -> None:
    f = gradients(d).requires_grad_()
    (expected,) = torch.autograd.grad(energy_density(f, material(volumetric)).sum(), f)
    torch.testing.assert_close(stress(f, material(volumetric)), expected)


@pytest.mark.parametrize("volumetric", VOLUMETRIC)
@pytest.mark.parametrize("d", [2, 3])
def test_moduli_are_those_of_the_stress(d: int, volumetric: Volumetric) -> None:
    """∂P/∂F : H = μ H + (μ − J U') F⁻ᵀ Hᵀ F⁻ᵀ + (J U' + J² U'') (F⁻ᵀ : H) F⁻ᵀ."""
    f, h = gradients(d), gradients(d).flip(2)
    jvp = torch.autograd.functional.jvp
    _, expected = jvp(lambda x: stress(x, material(volumetric)), f, h)  # type: ignore[no-untyped-call]
    found = torch.einsum("ijklp,klp->ijp", moduli(f, material(volumetric)), h)
    by_hand = MU * h + moved(f, h, volumetric)
    torch.testing.assert_close(by_hand, expected)
    torch.testing.assert_close(found, expected)


def test_inverted_material_has_infinite_energy() -> None:
    f = torch.tensor([[1.0, 0.0], [0.0, -1.0]], dtype=torch.float64)[..., None]
    for volumetric in VOLUMETRIC:
        assert energy_density(f, material(volumetric)).item() == math.inf
