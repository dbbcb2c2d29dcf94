r"""Isotropic materials: those of two moduli of linear elasticity, and rubber-like ones.

The energy of rubber-like ones is a volume-preserving part and K/2 (J − 1)². They use the invariants
of the volume-preserving part of the deformation, :math:`\bar I_1 = J^{-2/3} I_1` and :math:`\bar
I_2 = J^{-4/3} I_2`.

Ogden's solid is a smooth function of the invariants, without eigenvalues. The sums of powers of the
volume-preserving principal stretches are traces of powers,

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
from collections.abc import Callable
from functools import cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.special import roots_jacobi

from shared_schema.materials.material import (
    LARGEST_MODULUS,
    Functions,
    Invariants,
    Material,
    Scalar,
)

Volumetric = Literal["paper", "quadratic"]


class VolumetricTerm(NamedTuple):
    r"""Volumetric term U(J) of the Neo-Hookean solid, with all that is derived from it.

    Both terms have :math:`U(1) = U'(1) = 0` and :math:`U''(1) = λ`, so they agree for small
    strains. They differ by a single number q:

    .. math:: U = λ \left[\tfrac{q}{2} (J - 1)^2 + (1 - q) (J - 1 - \ln J)\right], \qquad
              U' = λ \left[q J + 1 - 2 q - \tfrac{1 - q}{J}\right].

    The functions take numbers, arrays, tensors and UFL expressions alike.

    Attributes
    ----------
    square : float
        q.
    energy : callable
        U from λ, J and ln J.
    first : callable
        J U' from λ and J: the volumetric part of the Kirchhoff stress.
    second : callable
        J U' + J² U'' from λ and J: its derivative by ln J.
    """

    square: float
    energy: Callable[[Scalar, Scalar, Scalar], Scalar]
    first: Callable[[Scalar, Scalar], Scalar]
    second: Callable[[Scalar, Scalar], Scalar]


VOLUMETRIC_TERMS: dict[Volumetric, VolumetricTerm] = {
    "paper": VolumetricTerm(  # Deshpande et al. (2022), Eq. (Neo-Hookean)
        square=0.5,
        energy=lambda lam, j, log_j: lam / 4 * (j**2 - 1 - 2 * log_j),
        first=lambda lam, j: lam / 2 * (j**2 - 1),
        second=lambda lam, j: lam * j**2,
    ),
    "quadratic": VolumetricTerm(  # AceFEM's element library
        square=1.0,
        energy=lambda lam, j, log_j: lam / 2 * (j - 1) ** 2,
        first=lambda lam, j: lam * j * (j - 1),
        second=lambda lam, j: lam * j * (2 * j - 1),
    ),
}


class YoungPoisson(Material):
    """Base of materials that are named by two moduli of linear elasticity.

    Attributes
    ----------
    young_modulus : float
        Young's modulus E in Pa, positive.
    poisson_ratio : float
        Poisson's ratio ν, above -1 and below 0.5.
    """

    young_modulus: float = Field(ge=1e-12, le=LARGEST_MODULUS)
    poisson_ratio: float = Field(gt=-1, lt=0.5)

    @property
    def lame_lambda(self) -> float:
        """First Lamé parameter λ = Eν / ((1 + ν)(1 − 2ν)) in Pa."""
        e, nu = self.young_modulus, self.poisson_ratio
        return e * nu / ((1 + nu) * (1 - 2 * nu))

    @property
    def lame_mu(self) -> float:
        """Shear modulus μ = E / (2(1 + ν)) in Pa."""
        return self.young_modulus / (2 * (1 + self.poisson_ratio))


class NeoHookean(YoungPoisson):
    """Compressible Neo-Hookean solid: W = μ/2 (I₁ − 3 − 2 ln J) + U(J).

    Attributes
    ----------
    volumetric : {"paper", "quadratic"}
        Name of the volumetric term U(J): λ/4 (J² − 1 − 2 ln J), or λ/2 (J − 1)².
    """

    model: Literal["neo_hookean"] = Field("neo_hookean", exclude=True)  # older cases lack it
    volumetric: Volumetric = "paper"

    @property
    def volumetric_term(self) -> VolumetricTerm:
        """U(J) and its derivatives."""
        return VOLUMETRIC_TERMS[self.volumetric]

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = μ/2 (I₁ − 3 − 2 ln J) + U(J)."""
        lam, mu, log_j = self.lame_lambda, self.lame_mu, of.ln(c.j)
        return mu / 2 * (c.i1 - 3 - 2 * log_j) + self.volumetric_term.energy(lam, c.j, log_j)


class StVenantKirchhoff(YoungPoisson):
    """St. Venant–Kirchhoff solid: W = λ/2 (tr E)² + μ E:E with the strain E = (C − I)/2.

    For large rotations and small strains; it softens under compression and can be crushed to J = 0.
    """

    model: Literal["st_venant_kirchhoff"] = "st_venant_kirchhoff"

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W with tr E = (I₁ − 3)/2 and E:E = (I₁² − 2 I₂ − 2 I₁ + 3)/4."""
        squares = c.i1**2 - 2 * c.i2 - 2 * c.i1 + 3
        return self.lame_lambda / 8 * (c.i1 - 3) ** 2 + self.lame_mu / 4 * squares


EIGHT_CHAINS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)  # of Arruda and Boyce


def first_invariant(c: Invariants) -> Scalar:
    """Ī₁ = J^(−2/3) I₁."""
    return c.j ** (-2 / 3) * c.i1


def second_invariant(c: Invariants) -> Scalar:
    """Ī₂ = J^(−4/3) I₂."""
    return c.j ** (-4 / 3) * c.i2


class RubberLike(Material):
    """Base of materials whose energy is a volume-preserving part plus K/2 (J − 1)².

    Attributes
    ----------
    bulk_modulus : float
        K in Pa; K/μ = 50 corresponds to ν = 0.49.
    """

    bulk_modulus: float = Field(ge=1e-12, le=LARGEST_MODULUS)

    def volumetric(self, j: Scalar) -> Scalar:
        """U(J) = K/2 (J − 1)²."""
        return self.bulk_modulus / 2 * (j - 1) ** 2


class MooneyRivlin(RubberLike):
    """Mooney–Rivlin solid: W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + K/2 (J − 1)².

    Attributes
    ----------
    c10, c01 : float
        Moduli in Pa; the shear modulus at rest is 2 (c₁₀ + c₀₁).
    """

    model: Literal["mooney_rivlin"] = "mooney_rivlin"
    c10: float = Field(ge=0, le=LARGEST_MODULUS)
    c01: float = Field(ge=0, le=LARGEST_MODULUS)

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + K/2 (J − 1)²."""
        first, second = first_invariant(c) - 3, second_invariant(c) - 3
        return self.c10 * first + self.c01 * second + self.volumetric(c.j)


class Yeoh(RubberLike):
    """Yeoh's solid: W = Σₖ cₖ₀ (Ī₁ − 3)ᵏ + K/2 (J − 1)² with k = 1, 2, 3.

    Attributes
    ----------
    c10, c20, c30 : float
        Moduli in Pa; the shear modulus at rest is 2 c₁₀.
    """

    model: Literal["yeoh"] = "yeoh"
    c10: float = Field(ge=0, le=LARGEST_MODULUS)
    c20: float = Field(0.0, ge=-LARGEST_MODULUS, le=LARGEST_MODULUS)
    c30: float = Field(0.0, ge=-LARGEST_MODULUS, le=LARGEST_MODULUS)

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = Σₖ cₖ₀ (Ī₁ − 3)ᵏ + K/2 (J − 1)²."""
        first = first_invariant(c) - 3
        return first * (self.c10 + first * (self.c20 + first * self.c30)) + self.volumetric(c.j)


class Gent(RubberLike):
    """Gent's solid, whose chains have a limit: W = −μ/2 Jₘ ln(1 − (Ī₁ − 3)/Jₘ) + K/2 (J − 1)².

    Attributes
    ----------
    shear_modulus : float
        μ in Pa.
    limit : float
        Jₘ, the value that Ī₁ − 3 cannot reach.
    """

    model: Literal["gent"] = "gent"
    shear_modulus: float = Field(ge=1e-12, le=LARGEST_MODULUS)
    limit: float = Field(ge=1e-3, le=1e9)

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = −μ/2 Jₘ ln(1 − (Ī₁ − 3)/Jₘ) + K/2 (J − 1)²; it has no value beyond the limit."""
        first = first_invariant(c) - 3
        chains = -self.shear_modulus / 2 * self.limit * of.ln(1 - first / self.limit)
        return chains + self.volumetric(c.j)


class ArrudaBoyce(RubberLike):
    r"""Arruda and Boyce's solid of eight chains, by five terms of the inverse Langevin function.

    .. math:: W = μ \sum_{i=1}^{5} \frac{a_i}{λ_m^{2i-2}} (\bar I_1^i - 3^i)
              + \tfrac{K}{2} (J - 1)^2, \qquad
              a = \tfrac12, \tfrac1{20}, \tfrac{11}{1050}, \tfrac{19}{7000}, \tfrac{519}{673750} .

    Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389, Eq. 17.

    Attributes
    ----------
    shear_modulus : float
        μ in Pa. The shear modulus at rest is larger:
        μ (1 + 3/(5 λₘ²) + 99/(175 λₘ⁴) + 513/(875 λₘ⁶) + 42039/(67375 λₘ⁸)).
    limit_stretch : float
        λₘ, the stretch of a chain at its full length.
    """

    model: Literal["arruda_boyce"] = "arruda_boyce"
    shear_modulus: float = Field(ge=1e-12, le=LARGEST_MODULUS)
    limit_stretch: float = Field(ge=1, le=1e6)

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = μ Σᵢ aᵢ / λₘ^(2i−2) (Ī₁ⁱ − 3ⁱ) + K/2 (J − 1)²."""
        first, chain = first_invariant(c), self.limit_stretch**-2
        terms = [
            a * chain**i * (first ** (i + 1) - 3 ** (i + 1)) for i, a in enumerate(EIGHT_CHAINS)
        ]
        return self.shear_modulus * sum(terms[1:], terms[0]) + self.volumetric(c.j)


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
