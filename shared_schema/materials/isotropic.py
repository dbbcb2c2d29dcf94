r"""Isotropic materials that are named by two moduli of linear elasticity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from pydantic import Field

from shared_schema.materials.material import LARGEST_MODULUS, Material
from shared_schema.materials.signature import Functions, Invariants, Scalar

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
