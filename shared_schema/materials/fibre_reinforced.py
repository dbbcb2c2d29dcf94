"""Materials with fibres: the layers of an artery's wall, and the heart's muscle."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from shared_schema.materials.fibres import FibreReinforced
from shared_schema.materials.material import LARGEST_MODULUS
from shared_schema.materials.rubber_like import RubberLike, first_invariant
from shared_schema.materials.signature import Functions, Invariants, Scalar


class HolzapfelGasserOgden(RubberLike, FibreReinforced):
    r"""Holzapfel, Gasser and Ogden's wall of an artery, with one or two families of fibres.

    .. math:: W = c_{10} (\bar I_1 - 3)
              + \frac{k_1}{2 k_2} \sum_i \left[\exp(k_2 \langle E_i \rangle^2) - 1\right]
              + \tfrac{K}{2} (J - 1)^2, \qquad
              E_i = κ (\bar I_1 - 3) + (1 - 3 κ) (\bar I_{4i} - 1)

    with :math:`\bar I_{4i} = J^{-2/3} I_{4i}` and :math:`\langle E \rangle = \max(E, 0)`.
    Holzapfel, Gasser and Ogden, J. Elasticity 61 (2000) 1; with the dispersion κ, Gasser, Ogden and
    Holzapfel, J. R. Soc. Interface 3 (2006) 15. The fibres' part is volume-preserving: the
    model is meant for tissue that is nearly incompressible.

    Attributes
    ----------
    c10 : float
        Modulus of the matrix in Pa, half its shear modulus.
    k1 : float
        Stiffness of the fibres in Pa.
    k2 : float
        How fast they stiffen.
    kappa : float
        κ: 0 if all fibres of a family have one direction, 1/3 if they have all directions alike.
    compression : bool
        Fibres bear compression as well: E instead of ⟨E⟩.
    """

    families: ClassVar[int | tuple[int, int]] = (1, 2)

    model: Literal["holzapfel_gasser_ogden"] = "holzapfel_gasser_ogden"
    c10: float = Field(ge=1e-12, le=LARGEST_MODULUS)
    k1: float = Field(ge=0, le=LARGEST_MODULUS)
    k2: float = Field(ge=1e-3, le=1e6)
    kappa: float = Field(0.0, ge=0, le=1 / 3)
    compression: bool = False

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = c₁₀ (Ī₁ − 3) + k₁/(2 k₂) Σᵢ (exp(k₂ ⟨Eᵢ⟩²) − 1) + K/2 (J − 1)²."""
        first = first_invariant(c) - 3
        w = self.c10 * first + self.volumetric(c.j)
        for family in c.fibres:
            along = c.j ** (-2 / 3) * family.stretch - 1
            strain = self.kappa * first + (1 - 3 * self.kappa) * along
            borne = strain if self.compression else of.positive(strain)
            w = w + self.k1 / (2 * self.k2) * (of.exp(self.k2 * borne**2) - 1)
        return w


class Guccione(RubberLike, FibreReinforced):
    r"""Guccione, McCulloch and Waldman's passive muscle of the heart, with fibres along f.

    .. math::
        W = \tfrac{C}{2} (e^Q - 1) + \tfrac{K}{2} (J - 1)^2, \qquad
        Q = b_f E_{ff}^2 + b_t (E_{ss}^2 + E_{nn}^2 + 2 E_{sn}^2) + 2 b_{fs} (E_{fs}^2 + E_{fn}^2)

    with the strain E = (C − I)/2 along the fibres f and across them, s and n, by invariants:

    .. math::
        E_{ff} = \tfrac12 (I_4 - 1), \qquad
        |E f|^2 = \tfrac14 (I_5 - 2 I_4 + 1), \qquad
        E : E = \tfrac14 (I_1^2 - 2 I_2 - 2 I_1 + 3), \\
        E_{fs}^2 + E_{fn}^2 = |E f|^2 - E_{ff}^2, \qquad
        E_{ss}^2 + E_{nn}^2 + 2 E_{sn}^2 = E:E - 2 |E f|^2 + E_{ff}^2 .

    E is that of the whole deformation, as in the benchmarks of Land et al., Proc. R. Soc. A 471
    (2015) 20150641, whose bodies are incompressible: with ``element: incompressible`` and K far
    above C. Guccione, McCulloch and Waldman, J. Biomech. Eng. 113 (1991) 42.

    Attributes
    ----------
    stiffness : float
        C in Pa.
    b_f, b_t, b_fs : float
        Stiffness along the fibres, across them, and of shear between both, over C.
    """

    families: ClassVar[int | tuple[int, int]] = 1

    model: Literal["guccione"] = "guccione"
    stiffness: float = Field(ge=1e-12, le=LARGEST_MODULUS)
    b_f: float = Field(ge=1e-3, le=1e6)
    b_t: float = Field(ge=1e-3, le=1e6)
    b_fs: float = Field(ge=1e-3, le=1e6)

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W = C/2 (exp Q − 1) + K/2 (J − 1)²."""
        (family,) = c.fibres
        along = ((family.stretch - 1) / 2) ** 2
        row = (family.fifth(c.i1, c.i2) - 2 * family.stretch + 1) / 4
        whole = (c.i1**2 - 2 * c.i2 - 2 * c.i1 + 3) / 4
        q = self.b_f * along + self.b_t * (whole - 2 * row + along) + 2 * self.b_fs * (row - along)
        return self.stiffness / 2 * (of.exp(q) - 1) + self.volumetric(c.j)
