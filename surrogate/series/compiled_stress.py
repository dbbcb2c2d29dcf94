"""Terms of the stress under one load, compiled: `surrogate.series.stress_series`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surrogate.series.compiled_fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_trace,
    compiled,
)


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
        scalars = (np.zeros((order, gradient.shape[-1]), gradient.dtype) for _ in range(3))
        return cls(h, np.zeros_like(h), *scalars)


@compiled
def next_stress(k: int, terms: Terms, mu: float, growth: float, decay: float) -> Array:
    r"""Complete the terms k - 1 from their H, and begin those of order k as if :math:`H_k = 0`.

    Parameters
    ----------
    k : int
        2 at least; all orders from 2 on, in turn.
    terms : Terms
    mu, growth, decay : float
        From `surrogate.series.stress_series.factors`.

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
