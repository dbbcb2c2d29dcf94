r"""The Neo-Hookean solid: strain energy density, stress, and moduli of the tangent.

.. math::
    W(F) = \tfrac{μ}{2} (F:F - d - 2 \ln J) + U(J), \qquad J = \det F

with the volumetric terms U of `shared_schema.material` (W in J/m³; plane strain for d = 2).
With :math:`∂J/∂F = J F^{-T}` its derivatives are

.. math::
    P = \frac{∂W}{∂F} = μ (F - F^{-T}) + J U' F^{-T},

.. math::
    \frac{∂P}{∂F} : H = μ H + (μ - J U') F^{-T} H^T F^{-T} + (J U' + J^2 U'') (F^{-T} : H) F^{-T}.

=========  ===========================  ============================  ==========================
U          U(J)                         J U'                          J U' + J² U''
=========  ===========================  ============================  ==========================
paper      :math:`λ/4 (J² - 1 - 2 ln    :math:`λ/2 (J² - 1)`          :math:`λ J²`
           J)`
quadratic  :math:`λ/2 (J - 1)²`         :math:`λ J (J - 1)`           :math:`λ J (2 J - 1)`
=========  ===========================  ============================  ==========================

Tensors have their components first: F is (d, d, …), scalars are (…). Where J ≤ 0 the material is
turned inside out; its energy there is +∞.
"""

from __future__ import annotations

import torch
from torch import Tensor

from shared_schema.material import NeoHookean


def determinant(f: Tensor) -> Tensor:
    """J = det F: (d, d, …) → (…)."""
    if len(f) == 2:
        return f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    j: Tensor = (f[0] * torch.linalg.cross(f[1], f[2], dim=0)).sum(0)
    return j


def inverse_transpose(f: Tensor, j: Tensor) -> Tensor:
    """F⁻ᵀ, the cofactors of F over J: (d, d, …), (…) → (d, d, …)."""
    if len(f) == 2:
        rows = torch.stack([f[1, 1], -f[1, 0]]), torch.stack([-f[0, 1], f[0, 0]])
    else:
        rows = tuple(torch.linalg.cross(f[a], f[b], dim=0) for a, b in ((1, 2), (2, 0), (0, 1)))
    return torch.stack(rows) / j


def energy_density(f: Tensor, material: NeoHookean) -> Tensor:
    """W(F) in J/m³, +∞ where J ≤ 0: (d, d, …) → (…)."""
    j = determinant(f)
    inside = j > 0
    logarithm = torch.log(torch.where(inside, j, torch.ones_like(j)))
    lam, mu = material.lame_lambda, material.lame_mu
    w = mu / 2 * (f.square().sum((0, 1)) - len(f) - 2 * logarithm)
    if material.volumetric == "paper":
        w = w + lam / 4 * (j.square() - 1 - 2 * logarithm)
    else:
        w = w + lam / 2 * (j - 1).square()
    return torch.where(inside, w, torch.inf)


def volumetric_derivatives(j: Tensor, material: NeoHookean) -> tuple[Tensor, Tensor]:
    """J U' and J U' + J² U'' in Pa: (…) → (…), (…)."""
    lam = material.lame_lambda
    if material.volumetric == "paper":
        return lam / 2 * (j.square() - 1), lam * j.square()
    return lam * j * (j - 1), lam * j * (2 * j - 1)


def stress(f: Tensor, material: NeoHookean) -> Tensor:
    """First Piola–Kirchhoff stress P = ∂W/∂F in Pa: (d, d, …) → (d, d, …)."""
    j = determinant(f)
    pressure, _ = volumetric_derivatives(j, material)
    mu = material.lame_mu
    return mu * f + (pressure - mu) * inverse_transpose(f, j)


def tangent_moduli(j: Tensor, material: NeoHookean) -> tuple[Tensor, Tensor]:
    """μ − J U' and J U' + J² U'' in Pa, the factors of ∂P/∂F: (…) → (…), (…)."""
    pressure, squared = volumetric_derivatives(j, material)
    return material.lame_mu - pressure, squared
