"""The combination of the terms of a load series with the least potential energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from shared_schema.material import NeoHookean
from surrogate.mechanics.series.arrays import constant, library_of, like
from surrogate.mechanics.series.least_energy import least_energy
from surrogate.mechanics.series.series_stress import SeriesStress, higher_terms

Array = Any  # of NumPy, or a Tensor


def beyond_linear(
    material: NeoHookean,
    volumes: Array,
    order: int,
    first: Array,
    gradient: Callable[[Array], Array],
    balanced: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Return Σₖ cₖ uₖ - u₁ and the last term cₙ uₙ in m, (…, n_dofs) each, of u₁.

    Parameters
    ----------
    material : NeoHookean
    volumes : array, (n_points,)
        Of the quadrature points in m³ (m² in the plane).
    order : int
        Order n, 2 at least.
    first : array, (…, n_dofs)
        u₁ in m.
    gradient : callable
        Displacements in m to their gradients, (…, n_dofs) → (…, d, d, n_points).
    balanced : callable
        Stresses in Pa to the displacements that balance them, (…, d, d, n_points) → (…, n_dofs).
    """
    slope = gradient(first)
    terms, slopes = higher_terms(SeriesStress(material, slope), order, gradient, balanced)
    every = library_of(first).stack([first, *terms], -2)
    c = least_energy(material, volumes, [slope, *slopes])
    last = like(first, c[..., -1:]) * terms[-1]
    beyond = c - constant(np.eye(1, order)[0], c)
    return (like(first, beyond)[..., None, :] @ every)[..., 0, :], last
