r"""Series of the Neo-Hookean stress on a path of deformations, term by term.

.. math::
    F = I + \sum_k t^k H_k, \qquad F^{-1} = \sum_k t^k G_k, \qquad \ln J = \sum_k t^k \ell_k, \qquad
    J^a = \sum_k t^k E_k^a, \qquad P = \sum_k t^k P_k

From :math:`F F^{-1} = I`, :math:`(\ln J)' = \mathrm{tr} (F^{-1} F')` and
:math:`(J^a)' = a \, J^a (\ln J)'` follow, beginning with :math:`G_0 = I` and :math:`E_0^a = 1`,

.. math::
    G_k = -\sum_{j=1}^k H_j G_{k-j}, \qquad
    k \, \ell_k = \sum_{j=1}^k j \, \mathrm{tr} (G_{k-j} H_j), \qquad
    k \, E_k^a = a \sum_{j=1}^k j \, \ell_j E_{k-j}^a,

.. math::
    P_k = μ (H_k - G_k^T) + \sum_{j=1}^k p_j G_{k-j}^T, \qquad
    p_j = \tfrac{λ}{2} E_j^2 \;\text{or}\; λ (E_j^2 - E_j^1),

the coefficients of J U' with the two volumetric terms (`surrogate.mechanics.neo_hookean`). The
formulas hold for arrays of NumPy as for tensors; those have their components first, (d, d, …).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from shared_schema.material import NeoHookean

Array = Any  # of NumPy, or a Tensor
# J U' = Σ_a w_a λ (J^a - 1): w_a of every a
VOLUMETRIC = {"paper": {2: 0.5}, "quadratic": {2: 1.0, 1: -1.0}}


class SeriesStress:
    """Terms of the stress in Pa, from terms of the displacement gradient: (d, d, …).

    Parameters
    ----------
    material : NeoHookean
    first : array or Tensor, (d, d, …)
        H₁.
    """

    def __init__(self, material: NeoHookean, first: Array) -> None:
        library = torch if isinstance(first, torch.Tensor) else np
        self.stack, self.einsum = library.stack, library.einsum
        self.lam, self.mu = material.lame_lambda, material.lame_mu
        self.weights = VOLUMETRIC[material.volumetric]
        trace = _trace(first)
        self.h, self.multiples = [first], [first]  # H_j and j H_j
        self.g = [-first]  # G₁, G₂, …
        self.l = [trace]  # j ℓ_j
        self.powers = {a: [a * trace] for a in self.weights}  # E₁, E₂, …
        self.p = [self._pressure()]

    def next_without(self) -> Array:
        """The next P_k without the part that is linear in H_k, as if H_k = 0."""
        k = len(self.h) + 1
        backwards = self.stack(self.g[::-1])
        inverse = self.einsum("mij...,mjk...->ik...", self.stack(self.h), backwards)
        l_k = self.einsum("mij...,mji...->...", self.stack(self.multiples), backwards)
        for a, e in self.powers.items():
            products = self.einsum("m...,m...->...", self.stack(self.l), self.stack(e[::-1]))
            e.append((a / k) * (products + l_k))
        self.l.append(l_k)
        stress = self.einsum("m...,mij...->ji...", self.stack(self.p), backwards)
        stress = stress + self.mu * inverse.swapaxes(0, 1)
        self.g.append(-inverse)
        self.p.append(self._pressure())
        for i in range(len(inverse)):
            stress[i, i] += self.p[-1]
        return stress

    def add(self, h: Array) -> None:
        """Set H_k, after `next_without`."""
        trace, k = _trace(h), len(self.h) + 1
        self.h.append(h)
        self.multiples.append(k * h)
        self.g[-1] = self.g[-1] - h
        self.l[-1] = self.l[-1] + k * trace
        for a, e in self.powers.items():
            e[-1] = e[-1] + a * trace
        self.p[-1] = self._pressure()

    def _pressure(self) -> Array:
        """The last p_k."""
        parts = [self.lam * w * self.powers[a][-1] for a, w in self.weights.items()]
        return sum(parts[1:], start=parts[0])


def beyond_first(
    series: SeriesStress,
    order: int,
    gradient: Callable[[Array], Array],
    balanced: Callable[[Array], Array],
) -> Array:
    """u₂ + … + u_n in m, whose gradients follow one by one from those before.

    Parameters
    ----------
    series : SeriesStress
        Of the gradient of u₁.
    order : int
        Order n, 2 at least.
    gradient : callable
        Displacements in m to their gradients, (d, d, …).
    balanced : callable
        Stresses in Pa, (d, d, …), to the displacements that balance them.
    """
    beyond = term = balanced(series.next_without())
    for _ in range(2, order):
        series.add(gradient(term))
        term = balanced(series.next_without())
        beyond = beyond + term
    return beyond


def _trace(h: Array) -> Array:
    """Traces: (d, d, …) → (…)."""
    diagonal = [h[i, i] for i in range(len(h))]
    return sum(diagonal[1:], start=diagonal[0])
