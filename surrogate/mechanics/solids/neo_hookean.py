r"""The Neo-Hookean solid: strain energy density, stress, and moduli of the tangent.

.. math::
    W(F) = \tfrac{μ}{2} (F:F - d - 2 \ln J) + U(J), \qquad J = \det F

with the volumetric terms U of `shared_schema.materials`, which has J U' and J U' + J² U'' as well
(W in J/m³; plane strain for d = 2). With :math:`∂J/∂F = J F^{-T}` the derivatives are

.. math::
    P = \frac{∂W}{∂F} = μ (F - F^{-T}) + J U' F^{-T},

.. math::
    \frac{∂P}{∂F} : H = μ H + (μ - J U') F^{-T} H^T F^{-T} + (J U' + J^2 U'') (F^{-T} : H) F^{-T}.

Tensors have their components first: F is (d, d, …), scalars are (…). Where J ≤ 0 the material is
turned inside out; its energy there is +∞.
"""

from __future__ import annotations

import torch
from torch import Tensor

from shared_schema.materials import NeoHookean


def determinant(f: Tensor) -> Tensor:
    """J = det F: (d, d, …) → (…)."""
    if len(f) == 2:
        return f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    return (f[0] * torch.linalg.cross(f[1], f[2], dim=0)).sum(0)


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
    w = material.lame_mu / 2 * (f.square().sum((0, 1)) - len(f) - 2 * logarithm)
    w = w + material.volumetric_term.energy(material.lame_lambda, j, logarithm)
    return torch.where(inside, w, torch.inf)


def stress(f: Tensor, material: NeoHookean) -> Tensor:
    """First Piola–Kirchhoff stress P = ∂W/∂F in Pa: (d, d, …) → (d, d, …)."""
    j, mu = determinant(f), material.lame_mu
    pressure = material.volumetric_term.first(material.lame_lambda, j)
    return mu * f + (pressure - mu) * inverse_transpose(f, j)


def tangent_moduli(j: Tensor, material: NeoHookean) -> tuple[Tensor, Tensor]:
    """μ − J U' and J U' + J² U'' in Pa, the factors of ∂P/∂F: (…) → (…), (…)."""
    lam, term = material.lame_lambda, material.volumetric_term
    return material.lame_mu - term.first(lam, j), term.second(lam, j)
