"""The combination of the terms of a load series under one load, on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.material import NeoHookean
from surrogate.series.compiled_energy import least_energy, potential_of_terms
from surrogate.series.compiled_fields import Array
from surrogate.series.compiled_stress import Terms, next_stress
from surrogate.series.stress_series import factors

Field = NDArray[Any]


def beyond_linear_of_one(
    material: NeoHookean,
    volumes: Array,
    order: int,
    first: Field,
    gradient: Callable[[Field], Field],
    balanced: Callable[[Field], Field],
) -> tuple[Field, Field]:
    """Do what `surrogate.series.best_response.beyond_linear` does, of one load.

    Parameters
    ----------
    material : NeoHookean
    volumes : array, (n_points,)
        Of the quadrature points in m³ (m² in the plane), in the precision of the fields.
    order : int
        Order n, 2 at least.
    first : array, (n_dofs,)
        u₁ in m.
    gradient : callable
        Displacements in m to their gradients, (n_dofs,) → (d, d, n_points).
    balanced : callable
        Stresses in Pa to the displacements that balance them, (d, d, n_points) → (n_dofs,).
    """
    slope = gradient(first)
    every = np.empty((order, len(first)), first.dtype)
    every[0], terms = first, Terms.zeros(order, slope)
    for k in range(2, order + 1):
        every[k - 1] = balanced(next_stress(k, terms, *factors(material)))
        terms.h[k - 1] = gradient(every[k - 1])
    potential = potential_of_terms(material, volumes, terms.h)
    c = least_energy(potential, float(np.finfo(slope.dtype).eps))[1:]
    c[0] -= 1
    c = c.astype(first.dtype)
    return c @ every, c[-1] * every[-1]
