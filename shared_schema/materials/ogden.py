r"""Ogden's solid, as a smooth function of the invariants, without eigenvalues.

The sums of powers of the volume-preserving principal stretches are traces of powers,

.. math:: \barλ_1^α + \barλ_2^α + \barλ_3^α = \operatorname{tr} \bar C^{α/2}, \qquad
          \bar C = J^{-2/3} C ,

and consecutive ones obey the equation of Cayley and Hamilton (:math:`\det \bar C = 1`), upwards and
downwards:

.. math:: \operatorname{tr} \bar C^{s+3} = \bar I_1 \operatorname{tr} \bar C^{s+2}
          - \bar I_2 \operatorname{tr} \bar C^{s+1} + \operatorname{tr} \bar C^s .

For whole s they begin with 3, :math:`\bar I_1` and :math:`\bar I_1^2 - 2 \bar I_2`. For others they
begin with :math:`-1 < s < 0`, by Gauss–Jacobi quadrature of

.. math:: x^s = \frac{\sin(-π s)}{π} \int_0^\infty \frac{t^s}{t + x} \, dt, \qquad
          \operatorname{tr} (t + \bar C)^{-1}
          = \frac{3 t^2 + 2 \bar I_1 t + \bar I_2}{t^3 + \bar I_1 t^2 + \bar I_2 t + 1} ,

with :math:`t = (1 - y) / (1 + y)`. With n points it is the Padé approximant about
:math:`\bar C = I`; a stretch :math:`\barλ` has the relative error
:math:`O((\barλ - 1)^{2n} / (\barλ + 1)^{2n})`. Equal stretches are no special case.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.special import roots_jacobi

from shared_schema.materials.material import LARGEST_MODULUS
from shared_schema.materials.rubber_like import RubberLike, first_invariant, second_invariant
from shared_schema.materials.signature import Functions, Invariants, Scalar

POINTS = 28  # (3/5)^56 = 4e-13 at stretches of 4 and 1/4
LARGEST_EXPONENT = 20.0
Modulus = Annotated[float, Field(ge=-LARGEST_MODULUS, le=LARGEST_MODULUS)]
Exponent = Annotated[float, Field(ge=-LARGEST_EXPONENT, le=LARGEST_EXPONENT)]


class Ogden(RubberLike):
    r"""Ogden's solid of N terms.

    .. math:: W = \sum_p \frac{μ_p}{α_p} (\barλ_1^{α_p} + \barλ_2^{α_p} + \barλ_3^{α_p} - 3)
              + \tfrac{K}{2} (J - 1)^2

    Exponents that are even numbers are exact; with others, W is right to about 1e-12 where the
    volume-preserving stretches are between 1/4 and 4, and to 1e-6 between 1/8 and 8. Ogden,
    Proc. R. Soc. Lond. A 326 (1972) 565.

    Attributes
    ----------
    mu : tuple of float
        μ_p in Pa; the shear modulus at rest is Σ μ_p α_p / 2.
    alpha : tuple of float
        α_p, as many, none of them 0.
    """

    model: Literal["ogden"] = "ogden"
    mu: tuple[Modulus, ...] = Field(min_length=1, max_length=8)
    alpha: tuple[Exponent, ...] = Field(min_length=1, max_length=8)

    def _key_problem(self) -> str | None:
        """Say which key is wrong beside the others."""
        key, count = f"key 'alpha' = {list(self.alpha)}", len(self.mu)
        if len(self.alpha) != count:
            return f"{key}: expected as many numbers as 'mu' has, {count}"
        return f"{key}: expected none of them 0" if 0 in self.alpha else None

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = Σ μ_p / α_p (tr C̄^(α_p/2) − 3) + K/2 (J − 1)²."""
        i1, i2 = first_invariant(c), second_invariant(c)
        terms = [
            mu / alpha * (trace_of_power(i1, i2, alpha / 2) - 3)
            for mu, alpha in zip(self.mu, self.alpha, strict=True)
        ]
        return sum(terms[1:], terms[0]) + self.volumetric(c.j)


def trace_of_power(i1: Scalar, i2: Scalar, exponent: float) -> Scalar:
    """Trace of C̄ˢ, of a positive definite C̄ with determinant 1, from its first two invariants."""
    steps = math.floor(exponent)
    fraction = exponent - steps
    if fraction:
        steps += 1  # from s = fraction − 1
        traces = _traces_of_fraction(i1, i2, fraction - 1)
    else:
        traces = 3.0, i1, i1**2 - 2 * i2
    low, middle, high = traces
    for _ in range(2, steps):
        low, middle, high = middle, high, i1 * high - i2 * middle + low
    for _ in range(steps, 0):
        low, middle, high = high - i1 * middle + i2 * low, low, middle
    return (low, middle, high)[min(max(steps, 0), 2)]


def _traces_of_fraction(i1: Scalar, i2: Scalar, s: float) -> tuple[Scalar, Scalar, Scalar]:
    """Traces of C̄ˢ, C̄ˢ⁺¹ and C̄ˢ⁺² with −1 < s < 0, from those of C̄ᵏ (t + C̄)⁻¹, k = 0, 1, 2."""
    sums: list[Scalar] = [0.0, 0.0, 0.0]
    for t, w in zip(*_quadrature(s), strict=True):
        weight = w / (t**3 + t**2 * i1 + t * i2 + 1)
        numerators = (
            3 * t**2 + 2 * t * i1 + i2,
            t**2 * i1 + 2 * t * i2 + 3,
            t**2 * (i1**2 - 2 * i2) + t * (i1 * i2 - 3) + i1,
        )
        sums = [part + weight * n for part, n in zip(sums, numerators, strict=True)]
    return sums[0], sums[1], sums[2]


@cache
def _quadrature(s: float) -> tuple[list[float], list[float]]:
    """Points t and weights w with xˢ = Σ w / (t + x), −1 < s < 0."""
    with np.errstate(invalid="ignore"):  # SciPy divides 0 by 0 before it puts in the limit
        y, weights = roots_jacobi(POINTS, s, -s - 1)
    t = (1 - y) / (1 + y)
    w = math.sin(-math.pi * s) / math.pi * weights * 2 / (1 + y)
    return t.tolist(), w.tolist()
