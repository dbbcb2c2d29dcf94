"""The combination of the terms of a load series with the least potential energy."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from shared_schema.material import NeoHookean
from surrogate.series.least_energy import least_energy
from surrogate.series.stress_series import SeriesStress, higher_terms


def beyond_linear(
    material: NeoHookean,
    volumes: Tensor,
    order: int,
    first: Tensor,
    gradient: Callable[[Tensor], Tensor],
    balanced: Callable[[Tensor], Tensor],
) -> tuple[Tensor, Tensor]:
    """Return Σₖ cₖ uₖ - u₁ and the last term cₙ uₙ in m, (…, n_dofs) each, of u₁.

    Parameters
    ----------
    material : NeoHookean
    volumes : Tensor, (n_points,)
        Of the quadrature points in m³ (m² in the plane).
    order : int
        Order n, 2 at least.
    first : Tensor, (…, n_dofs)
        u₁ in m.
    gradient : callable
        Displacements in m to their gradients, (…, n_dofs) → (…, d, d, n_points).
    balanced : callable
        Stresses in Pa to the displacements that balance them, (…, d, d, n_points) → (…, n_dofs).
    """
    slope = gradient(first)
    terms, slopes = higher_terms(SeriesStress(material, slope), order, gradient, balanced)
    every = torch.stack([first, *terms], -2)
    c = least_energy(material, volumes, [slope, *slopes])
    last = c[..., -1:].to(first) * terms[-1]
    beyond = c - torch.eye(1, order, dtype=c.dtype, device=c.device)[0]
    return (beyond.to(first)[..., None, :] @ every)[..., 0, :], last
