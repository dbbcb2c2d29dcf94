r"""Series of the Neo-Hookean stress on a path of deformations, term by term.

.. math::
    F = I + \sum_k t^k H_k, \qquad \mathrm{cof} F = \sum_k t^k C_k, \qquad
    J = \sum_k t^k J_k, \qquad \frac{1}{J} = \sum_k t^k R_k, \qquad P = \sum_k t^k P_k

With :math:`F^{-T} = \mathrm{cof} F / J` the stress (`surrogate.mechanics.solids.deformation`) is
:math:`P = μ F + s \, \mathrm{cof} F`, :math:`s = U' - μ / J`. From :math:`J' = \mathrm{cof} F : F'`
and :math:`J \, (1/J) = 1` follow, beginning with :math:`C_0 = I` and :math:`J_0 = R_0 = 1`,

.. math::
    C_k = (\mathrm{tr} H_k) I - H_k^T + \tfrac{1}{2} \sum_{j=1}^{k-1} H_j × H_{k-j}, \qquad
    k J_k = \sum_{j=1}^k j \, C_{k-j} : H_j, \qquad R_k = -\sum_{j=1}^k J_j R_{k-j},

.. math::
    P_k = μ H_k + \sum_{j=0}^k s_{k-j} C_j, \qquad
    s_k = g J_k - d R_k, \qquad s_0 = -μ

with the `Factors` of the volumetric term. The cross products are zero in the plane
(`surrogate.series.cofactors`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from torch import Tensor

from shared_schema.materials import NeoHookean
from surrogate.series.cofactors import (
    add_multiple,
    cofactors,
    contraction,
    cross_product,
    linear_cofactors,
    trace,
)


class Factors(NamedTuple):
    r"""Factors of the Neo-Hookean solid in Pa, for a series.

    With the number q of `shared_schema.materials.VolumetricTerm`, :math:`s = U' - μ / J` is
    :math:`g J - d / J` and a constant, and :math:`U(J) - μ \ln J` is
    :math:`\tfrac{g}{2} e^2 + d (e - \ln (1 + e))` and what is linear in e = J - 1.

    Attributes
    ----------
    mu : float
        μ.
    growth : float
        g = λ q.
    decay : float
        d = λ (1 - q) + μ.
    """

    mu: float
    growth: float
    decay: float

    @classmethod
    def of(cls, material: NeoHookean) -> Factors:
        """Return those of a material."""
        lam, mu = material.lame_lambda, material.lame_mu
        growth = lam * material.volumetric_term.square
        return cls(mu, growth, lam + mu - growth)


class SeriesStress:
    """Terms of the stress in Pa, from terms of the displacement gradient: (…, d, d, n_points).

    Parameters
    ----------
    material : NeoHookean
    first : Tensor, (…, d, d, n_points)
        H₁.
    """

    def __init__(self, material: NeoHookean, first: Tensor) -> None:
        self.mu, self.growth, self.decay = Factors.of(material)
        self.h = [first]
        self.c: list[Any] = [linear_cofactors(first)]  # Tensors; None is zero
        self.j = [trace(first)]
        self.r = [-self.j[0]]
        self.s = [self._s()]

    def next_without(self) -> Tensor:
        """The next P_k without the part that is linear in H_k, as if H_k = 0."""
        k = len(self.h) + 1
        products = [j * r for j, r in zip(self.j, self.r[::-1], strict=True)]
        self.j.append(self._jacobian(k))
        self.r.append(-sum(products, start=self.j[-1]))
        self.s.append(self._s())
        stress = self.s[-2][..., None, None, :] * self.c[0]
        for s, c in zip(self.s[-3::-1], self.c[1:], strict=True):
            stress += s[..., None, None, :] * c
        stress = add_multiple(stress, self.s[-1])
        self.c.append(self._products(k))
        if self.c[-1] is not None:
            stress -= self.mu * self.c[-1]
        return stress

    def add(self, h: Tensor) -> None:
        """Set H_k, after `next_without`."""
        of_h = trace(h)
        self.h.append(h)
        self.c[-1] = linear_cofactors(h) if self.c[-1] is None else self.c[-1] + linear_cofactors(h)
        self.j[-1] = self.j[-1] + of_h
        self.r[-1] = self.r[-1] - of_h
        self.s[-1] = self._s()

    def _jacobian(self, k: int) -> Tensor:
        """J_k without tr H_k; in the plane, C_j : H_{k-j} = C_{k-j} : H_j."""
        plane = self.h[0].shape[-2] == 2
        parts = [
            (1 if plane and 2 * j < k else j / k) * contraction(self.h[j - 1], self.c[k - j - 1])
            for j in range(1, k // 2 + 1 if plane else k)
        ]
        return sum(parts[1:], start=parts[0])

    def _products(self, k: int) -> Tensor | None:
        """½ Σ Hⱼ × H_{k-j}; None in the plane."""
        if self.h[0].shape[-2] == 2:
            return None
        parts = [cross_product(self.h[j - 1], self.h[k - j - 1]) for j in range(1, (k + 1) // 2)]
        if k % 2 == 0:
            parts.append(cofactors(self.h[k // 2 - 1]))
        return sum(parts[1:], start=parts[0])

    def _s(self) -> Tensor:
        """The last s_k."""
        return self.growth * self.j[-1] - self.decay * self.r[-1]


def higher_terms(
    series: SeriesStress,
    order: int,
    gradient: Callable[[Tensor], Tensor],
    balanced: Callable[[Tensor], Tensor],
) -> tuple[list[Tensor], list[Tensor]]:
    """u₂ … u_n in m, and their gradients, which follow one by one from those before.

    Parameters
    ----------
    series : SeriesStress
        Of the gradient of u₁.
    order : int
        Order n, 2 at least.
    gradient : callable
        Displacements in m to their gradients, (…, d, d, n_points).
    balanced : callable
        Stresses in Pa, (…, d, d, n_points), to the displacements that balance them.
    """
    terms: list[Tensor] = []
    gradients: list[Tensor] = []
    for _ in range(2, order + 1):
        if gradients:
            series.add(gradients[-1])
        terms.append(balanced(series.next_without()))
        gradients.append(gradient(terms[-1]))
    return terms, gradients
