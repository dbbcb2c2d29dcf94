r"""Rubber-like materials: a volume-preserving part of the energy, and K/2 (J − 1)².

They use the invariants of the volume-preserving part of the deformation,
:math:`\bar I_1 = J^{-2/3} I_1` and :math:`\bar I_2 = J^{-4/3} I_2`.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shared_schema.materials.material import LARGEST_MODULUS, Material
from shared_schema.materials.signature import Functions, Invariants, Scalar

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
