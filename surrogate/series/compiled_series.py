r"""The load series, compiled: terms of the stress, their combination, the response.

`next_stress` is the recursion of `surrogate.series.stress_series`, `beyond_linear_of_some` the
combination :math:`\sum_k c_k u_k` of `surrogate.series.series_response`, and `CompiledResponse`
does both on a large body, cell by cell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.material import NeoHookean
from surrogate.mechanics.compliance import Compliance
from surrogate.series.compiled_energy import least_energy, potential_of_terms
from surrogate.series.compiled_fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_trace,
    compiled,
    forces_of_cells,
    slopes_in_cells,
)
from surrogate.series.series_response import NEGLIGIBLE, CellOperators
from surrogate.series.stress_series import Factors

Field = NDArray[Any]


class Terms(NamedTuple):
    """Terms k = 1, 2, … of the fields of a series, in rows k - 1.

    Attributes
    ----------
    h : array, (n, d, d, n_points)
        Hₖ.
    c : array, (n, d, d, n_points)
        Cₖ.
    j, r, s : array, (n, n_points)
        Jₖ, Rₖ, sₖ.
    """

    h: Array
    c: Array
    j: Array
    r: Array
    s: Array

    @classmethod
    def zeros(cls, order: int, gradient: Array) -> Terms:
        """Make room for the terms of a series that begins with a gradient, (d, d, n_points)."""
        h = np.zeros((order, *gradient.shape), gradient.dtype)
        h[0] = gradient
        scalars = np.zeros((order, gradient.shape[-1]), gradient.dtype)
        return cls(h, np.zeros_like(h), scalars, scalars.copy(), scalars.copy())


@compiled
def next_stress(k: int, terms: Terms, mu: float, growth: float, decay: float) -> Array:
    r"""Complete the terms k - 1 from their H, and begin those of order k as if :math:`H_k = 0`.

    Parameters
    ----------
    k : int
        2 at least; all orders from 2 on, in turn.
    terms : Terms
    mu, growth, decay : float
        `surrogate.series.stress_series.Factors`.

    Returns
    -------
    array, (d, d, n_points)
        :math:`P_k` without the part that is linear in :math:`H_k`.
    """
    h, c, j, r, s = terms
    d, points = h.shape[1], h.shape[3]
    new, old = k - 1, k - 2
    of_f, of_j, of_r = h.dtype.type(mu), h.dtype.type(growth), h.dtype.type(decay)
    add_linear_cofactors(h[old], c[old])
    add_trace(1.0, h[old], j[old])
    add_trace(-1.0, h[old], r[old])
    for i in range(1, k):
        add_contraction(i / k, h[i - 1], c[k - i - 1], j[new])
    for q in range(points):
        s[old, q] = of_j * j[old, q] - of_r * r[old, q]
        r[new, q] = -j[new, q]
    for i in range(k - 1):
        for q in range(points):
            r[new, q] -= j[i, q] * r[old - i, q]
    for q in range(points):
        s[new, q] = of_j * j[new, q] - of_r * r[new, q]
    if d == 3:
        for i in range(1, k // 2 + 1):
            add_cross_product(0.5 if 2 * i == k else 1.0, h[i - 1], h[new - i], c[new])
    stress = np.empty(h.shape[1:], h.dtype)
    for a in range(d):
        for b in range(d):
            for q in range(points):
                stress[a, b, q] = -of_f * c[new, a, b, q]
            for i in range(k - 1):
                for q in range(points):
                    stress[a, b, q] += s[old - i, q] * c[i, a, b, q]
        for q in range(points):
            stress[a, a, q] += s[new, q]
    return stress


def beyond_linear_of_some(
    material: NeoHookean,
    volumes: Array,
    order: int,
    first: Field,
    gradient: Callable[[Field], Field],
    balanced: Callable[[list[Field]], Field],
) -> tuple[Field, Field]:
    """Do what `surrogate.series.series_response.beyond_linear` does, but fields load by load.

    Parameters
    ----------
    material : NeoHookean
    volumes : array, (n_points,)
        Of the quadrature points in any unit, in the precision of the fields.
    order : int
        Order n, 2 at least.
    first : array, (N, n_dofs)
        u₁ in m.
    gradient : callable
        Displacements in m to their gradients, (n_dofs,) → (d, d, n_points).
    balanced : callable
        Stresses in Pa to the displacements that balance them, N of (d, d, n_points) →
        (N, n_dofs).
    """
    every = np.zeros((len(first), order, first.shape[1]), first.dtype)
    c = np.zeros((len(first), order), first.dtype)
    slopes = [gradient(u) for u in first]
    eps = float(np.finfo(first.dtype).eps)
    seen = [k for k, slope in enumerate(slopes) if np.abs(slope).max() > NEGLIGIBLE * eps]
    terms = {n: Terms.zeros(order, slopes[n]) for n in seen}
    every[:, 0] = first
    for k in range(2, order + 1) if seen else ():
        stresses = [next_stress(k, of_load, *Factors.of(material)) for of_load in terms.values()]
        every[seen, k - 1] = balanced(stresses)
        for n, of_load in terms.items():
            of_load.h[k - 1] = gradient(every[n, k - 1])
    for n, of_load in terms.items():
        c[n] = least_energy(potential_of_terms(material, volumes, of_load.h), eps)[1:]
        c[n, 0] -= 1
    return (c[:, None] @ every)[:, 0], c[:, -1:] * every[:, -1]


class CompiledResponse:
    """What `SeriesResponse.beyond_first` finds, cell by cell.

    Parameters
    ----------
    higher : CellOperators
        On the CPU; its precision is that of all fields.
    compliance : Compliance
    order : int
        Order n.
    """

    def __init__(self, higher: CellOperators, compliance: Compliance, order: int) -> None:
        self.material, self.compliance, self.order = higher.material, compliance, order
        self.cells, self.volumes = higher.cells.numpy(), higher.volumes.numpy()
        self.shares = higher.shares.numpy()
        self.shape = compliance.equilibrium.free.shape
        count, corners, _ = higher.slopes.shape
        by_point = higher.slopes.numpy().reshape(count, corners, -1, self.shape[1])
        self.gradients = np.ascontiguousarray(by_point.swapaxes(2, 3))

    def __call__(self, first: Array) -> tuple[Array, Array]:
        """Response beyond u₁, and its last term, of u₁: (N, n_nodes, d) in m → same."""
        flat = first.reshape(len(first), -1)
        beyond, last = beyond_linear_of_some(
            self.material, self.shares, self.order, flat, self._gradient, self._balanced
        )
        return beyond.reshape(first.shape), last.reshape(first.shape)

    def _gradient(self, u: Array) -> Array:
        """Gradients at the quadrature points: (n_dofs,) → (d, d, n_points)."""
        return slopes_in_cells(self.cells, self.gradients, u.reshape(self.shape))

    def _balanced(self, stresses: list[Array]) -> Array:
        """Displacements that balance stresses: N of (d, d, n_points) → (N, n_dofs)."""
        of_cells = self.cells, self.gradients, self.volumes
        forces = [forces_of_cells(*of_cells, stress, self.shape[0]) for stress in stresses]
        return -self.compliance.respond_at_nodes(np.stack(forces)).reshape(len(forces), -1)
