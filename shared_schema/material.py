r"""The materials that a case can name, with their strain energies W in J per m³.

A material is isotropic and hyperelastic. Its energy is a function of

.. math:: I_1 = \operatorname{tr} C, \qquad I_2 = \tfrac12 (I_1^2 - \operatorname{tr} C^2), \qquad
          J = \det F, \qquad C = F^T F,

with the deformation gradient F, (3, 3); plane strain has :math:`F_{33} = 1`. A formula stands here
once; UFL and PyTorch both evaluate it. Rubber-like materials use the invariants of the volume-
preserving part of the deformation, :math:`\bar I_1 = J^{-2/3} I_1` and
:math:`\bar I_2 = J^{-4/3} I_2`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

from pydantic import Field, ValidationError, model_validator

from shared_schema.common.configuration import Frozen, absent, first_problem
from shared_schema.common.errors import InputError

Volumetric = Literal["paper", "quadratic"]
Scalar: TypeAlias = Any  # a float, a UFL expression, an array or a tensor
LARGEST_MODULUS = 1e18  # Pa


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


class Material(Frozen):
    """Base of all materials.

    Attributes
    ----------
    model : str
        Name of the model, or ``FILE.py:ClassName`` of a user's own one.
    group : str or None
        Physical group of the cells that are of this material, if a body has several.
    """

    model: str
    group: str | None = Field(None, min_length=1, exclude_if=absent)


class ShippedMaterial(Material, ABC):
    """A material that both programs know."""

    @property
    @abstractmethod
    def lame_lambda(self) -> float:
        """First Lamé parameter λ of the undeformed body in Pa."""

    @property
    @abstractmethod
    def lame_mu(self) -> float:
        """Shear modulus μ of the undeformed body in Pa."""

    @abstractmethod
    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W in J/m³ from I₁, I₂ and J, with a function for logarithms."""


class YoungPoisson(ShippedMaterial):
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

    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W = μ/2 (I₁ − 3 − 2 ln J) + U(J)."""
        lam, mu, log_j = self.lame_lambda, self.lame_mu, ln(j)
        return mu / 2 * (i1 - 3 - 2 * log_j) + self.volumetric_term.energy(lam, j, log_j)


class StVenantKirchhoff(YoungPoisson):
    """St. Venant–Kirchhoff solid: W = λ/2 (tr E)² + μ E:E with the strain E = (C − I)/2.

    For large rotations and small strains; it softens under compression and can be crushed to J = 0.
    """

    model: Literal["st_venant_kirchhoff"] = "st_venant_kirchhoff"

    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W with tr E = (I₁ − 3)/2 and E:E = (I₁² − 2 I₂ − 2 I₁ + 3)/4."""
        squares = i1**2 - 2 * i2 - 2 * i1 + 3
        return self.lame_lambda / 8 * (i1 - 3) ** 2 + self.lame_mu / 4 * squares


class RubberLike(ShippedMaterial):
    """Base of materials whose energy is a volume-preserving part plus K/2 (J − 1)².

    Attributes
    ----------
    bulk_modulus : float
        K in Pa; K/μ = 50 corresponds to ν = 0.49.
    """

    bulk_modulus: float = Field(ge=1e-12, le=LARGEST_MODULUS)

    @property
    def lame_lambda(self) -> float:
        """λ = K − 2/3 μ in Pa."""
        return self.bulk_modulus - 2 / 3 * self.lame_mu

    def volumetric(self, j: Scalar) -> Scalar:
        """U(J) = K/2 (J − 1)²."""
        return self.bulk_modulus / 2 * (j - 1) ** 2

    @model_validator(mode="after")
    def _is_stable(self) -> RubberLike:
        if not self.lame_mu > 0:
            raise ValueError(f"the shear modulus at rest is {self.lame_mu:g} Pa, expected above 0")
        return self


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

    @property
    def lame_mu(self) -> float:
        """μ = 2 (c₁₀ + c₀₁) in Pa."""
        return 2 * (self.c10 + self.c01)

    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W = c₁₀ (Ī₁ − 3) + c₀₁ (Ī₂ − 3) + K/2 (J − 1)²."""
        first, second = j ** (-2 / 3) * i1 - 3, j ** (-4 / 3) * i2 - 3
        return self.c10 * first + self.c01 * second + self.volumetric(j)


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

    @property
    def lame_mu(self) -> float:
        """μ = 2 c₁₀ in Pa."""
        return 2 * self.c10

    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W = Σₖ cₖ₀ (Ī₁ − 3)ᵏ + K/2 (J − 1)²."""
        first = j ** (-2 / 3) * i1 - 3
        return first * (self.c10 + first * (self.c20 + first * self.c30)) + self.volumetric(j)


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

    @property
    def lame_mu(self) -> float:
        """Shear modulus μ in Pa."""
        return self.shear_modulus

    def energy(self, i1: Scalar, i2: Scalar, j: Scalar, ln: Callable[[Scalar], Scalar]) -> Scalar:
        """W = −μ/2 Jₘ ln(1 − (Ī₁ − 3)/Jₘ) + K/2 (J − 1)²; it has no value beyond the limit."""
        first = j ** (-2 / 3) * i1 - 3
        chains = -self.shear_modulus / 2 * self.limit * ln(1 - first / self.limit)
        return chains + self.volumetric(j)


Materials: TypeAlias = ShippedMaterial | tuple[ShippedMaterial, ...]
SHIPPED: dict[str, type[ShippedMaterial]] = {
    "neo_hookean": NeoHookean,
    "st_venant_kirchhoff": StVenantKirchhoff,
    "mooney_rivlin": MooneyRivlin,
    "yeoh": Yeoh,
    "gent": Gent,
}


def shipped_material(content: Any) -> ShippedMaterial:
    """Build a material from plain data; ValueError if it is none of the shipped ones, or wrong."""
    if not isinstance(content, dict):
        raise ValueError("expected a mapping of the material's keys")
    name = content.get("model", "neo_hookean")
    if not isinstance(name, str) or name not in SHIPPED:
        raise ValueError(f"key 'model' = {name!r}: expected one of {', '.join(SHIPPED)}")
    try:
        return SHIPPED[name].model_validate(content)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from None


def materials_of(content: Any, source: str) -> Materials:
    """Build the material, or the materials of the groups, that a case configuration names.

    Parameters
    ----------
    content : Any
        Content of the key ``material``: a mapping, or a list of some, one a group.
    source : str
        Origin of the content, for the error message.

    Raises
    ------
    InputError
        If a material is none of the shipped ones (a user's own class is not imported), or wrong.
    """
    try:
        if isinstance(content, (list, tuple)) and content:
            return tuple(shipped_material(each) for each in content)
        return shipped_material(content)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None


def as_tuple(materials: Materials | Sequence[ShippedMaterial]) -> tuple[ShippedMaterial, ...]:
    """Return one material or several as a tuple."""
    return (materials,) if isinstance(materials, ShippedMaterial) else tuple(materials)


def ratio_at_rest(material: ShippedMaterial) -> float:
    """Poisson's ratio ν = λ / (2 (λ + μ)) of the undeformed body."""
    return material.lame_lambda / (2 * (material.lame_lambda + material.lame_mu))
