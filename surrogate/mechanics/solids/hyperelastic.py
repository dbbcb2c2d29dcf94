r"""Stress and moduli of any shipped material, from its strain energy by automatic differentiation.

.. math:: P = \frac{∂W}{∂F}, \qquad \mathbb{A}_{ijkl} = \frac{∂P_{ij}}{∂F_{kl}}, \qquad
          W = W(I_1, I_2, J)

with the energies of `shared_schema.materials`; in the plane :math:`F_{33} = 1`. The Neo-Hookean
solid has closed forms of its own (`surrogate.mechanics.solids.neo_hookean`). Tensors have their
components first: F is (d, d, …), scalars are (…). Where J ≤ 0, or a material has no energy, W is
+∞.
"""

from __future__ import annotations

import torch
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.materials import ZERO, Invariants, NeoHookean, ShippedMaterial
from surrogate.mechanics.solids import neo_hookean
from surrogate.mechanics.solids.neo_hookean import determinant


def energy_density(f: Tensor, material: ShippedMaterial) -> Tensor:
    """W(F) in J/m³, +∞ where J ≤ 0 or W has no value: (d, d, …) → (…)."""
    if isinstance(material, NeoHookean):
        return neo_hookean.energy_density(f, material)
    w, inside = _energy(f, material)
    return torch.where(inside & torch.isfinite(w), w, torch.inf)


def stress(f: Tensor, material: ShippedMaterial) -> Tensor:
    """First Piola–Kirchhoff stress P in Pa: (d, d, …) → (d, d, …)."""
    if isinstance(material, NeoHookean):
        return neo_hookean.stress(f, material)
    with torch.inference_mode(False), torch.enable_grad():
        variable = f.clone().requires_grad_()
        (p,) = torch.autograd.grad(_energy(variable, material)[0].sum(), variable)
    return p


def moduli(f: Tensor, material: ShippedMaterial) -> Tensor:
    """∂P/∂F in Pa: (d, d, …) → (d, d, d, d, …)."""
    d = len(f)
    with torch.inference_mode(False), torch.enable_grad():
        variable = f.clone().requires_grad_()
        w = _energy(variable, material)[0].sum()
        (p,) = torch.autograd.grad(w, variable, create_graph=True)
        rows = [
            torch.autograd.grad(p[i, j].sum(), variable, retain_graph=True)[0]
            for i in range(d)
            for j in range(d)
        ]
    return torch.stack(rows).reshape(d, d, *f.shape)


def completed(f: Tensor) -> Tensor:
    """F in three dimensions: plane strain is completed by F₃₃ = 1, (d, d, …) → (3, 3, …)."""
    if len(f) == 3:
        return f
    full = f.new_zeros((3, 3, *f.shape[2:]))
    full[:2, :2], full[2, 2] = f, 1.0
    return full


def _energy(f: Tensor, material: ShippedMaterial) -> tuple[Tensor, Tensor]:
    """W, of some value where J ≤ 0, and where it is the energy: (d, d, …) → (…), (…)."""
    if material.family_count:
        raise InputError(f"material '{material.model}': expected one without fibres")
    out_of_plane, j = 3 - len(f), determinant(f)
    inside = j > 0
    c = torch.einsum("ki...,kj...->ij...", f, f)
    i1 = f.square().sum((0, 1)) + out_of_plane
    i2 = (i1.square() - c.square().sum((0, 1)) - out_of_plane) / 2
    invariants = Invariants(i1, i2, torch.where(inside, j, torch.ones_like(j)))
    return material.energy(invariants, TENSORS), inside


class _OfTensors:
    """The functions that an energy may use, of tensors."""

    def ln(self, x: Tensor, /) -> Tensor:
        return torch.log(x)

    def exp(self, x: Tensor, /) -> Tensor:
        return torch.exp(x)

    def positive(self, x: Tensor, /) -> Tensor:
        return torch.where(x > -ZERO, x, torch.zeros_like(x))


TENSORS = _OfTensors()
