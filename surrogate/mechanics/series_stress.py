r"""Terms of the Neo-Hookean stress on a path of deformations.

.. math::
    F = I + t A + t^2 B, \qquad P = t P^{(1)} + t^2 P^{(2)} + t^3 P^{(3)} + O(t^4)

With the terms of the inverse, :math:`F^{-1} = I - \sum_k t^k X^{(k)}`,

.. math::
    X^{(1)} = A, \qquad X^{(2)} = B - A^2, \qquad X^{(3)} = A^3 - A B - B A,

those of the volume, :math:`\ln J = \sum_k t^k \ell_k`,

.. math::
    \ell_1 = \mathrm{tr} A, \qquad \ell_2 = \mathrm{tr} B - \tfrac{1}{2} \mathrm{tr} A^2, \qquad
    \ell_3 = \tfrac{1}{3} \mathrm{tr} A^3 - \mathrm{tr} (A B),

and those of :math:`J U' = λ (\ln J + g_2 \ln^2 J + g_3 \ln^3 J + …) = \sum_k t^k p_k`, the parts
of P that are not linear in A and B are

.. math::
    P^{(2)} = -μ (A^2)^T + (p_2 - λ \, \mathrm{tr} B) I - p_1 A^T, \qquad
    P^{(3)} = μ X^{(3) T} + p_3 I - p_2 A^T - p_1 X^{(2) T}.

The formulas hold for arrays of NumPy as for tensors.
"""

from __future__ import annotations

from typing import Any, TypeVar

from numpy.typing import NDArray
from torch import Tensor

from shared_schema.material import NeoHookean

Matrices = TypeVar("Matrices", Tensor, NDArray[Any])
# J U' = λ/2 (J² - 1) and λ J (J - 1), in powers of ln J
VOLUMETRIC = {"paper": (1.0, 2 / 3), "quadratic": (3 / 2, 7 / 6)}


class SeriesStress:
    """P⁽²⁾ and P⁽³⁾ in Pa of matrices (…, d, d).

    Parameters
    ----------
    material : NeoHookean
    """

    def __init__(self, material: NeoHookean) -> None:
        self.lam, self.mu = material.lame_lambda, material.lame_mu
        self.g2, self.g3 = VOLUMETRIC[material.volumetric]

    def second(self, a: Matrices, identity: Matrices) -> Matrices:
        """P⁽²⁾ of A; B has no part in it."""
        square, l1 = a @ a, trace(a)
        pressure = self.lam * (self.g2 * l1 * l1 - trace(square) / 2)
        p: Matrices = pressure * identity - (self.mu * square + self.lam * l1 * a).swapaxes(-1, -2)
        return p

    def third(self, a: Matrices, b: Matrices, identity: Matrices) -> Matrices:
        """P⁽³⁾ of A and B."""
        square, product = a @ a, a @ b
        cube = square @ a
        l1, l2 = trace(a), trace(b) - trace(square) / 2
        l3 = trace(cube) / 3 - trace(product)
        p2 = self.lam * (l2 + self.g2 * l1 * l1)
        p3 = self.lam * (l3 + 2 * self.g2 * l1 * l2 + self.g3 * l1 * l1 * l1)
        others = self.mu * (cube - product - b @ a) - p2 * a - self.lam * l1 * (b - square)
        p: Matrices = p3 * identity + others.swapaxes(-1, -2)
        return p


def trace(a: Matrices) -> Matrices:
    """Traces of matrices: (…, d, d) → (…, 1, 1)."""
    diagonal = [a[..., i, i] for i in range(a.shape[-1])]
    total: Matrices = sum(diagonal[1:], start=diagonal[0])
    return total[..., None, None]
