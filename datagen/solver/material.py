r"""Neo-Hookean strain energy density, with a choice of volumetric terms.

.. math::
    W(F) = \tfrac{\mu}{2} (I_c - 3 - 2 \ln J) + U(J), \qquad
    I_c = \operatorname{tr}(F^T F), \quad J = \det F

where F is the deformation gradient, (d, d), and W is in J per m³ of the undeformed body. The Lamé
parameters in Pa are

.. math:: \lambda = \frac{E\nu}{(1+\nu)(1-2\nu)}, \qquad \mu = \frac{E}{2(1+\nu)}.

The volumetric term U(J) is chosen by name:

===========  =====================================================  =========================
name         U(J)                                                   source
===========  =====================================================  =========================
paper        :math:`\lambda/4\,(J^2 - 1 - 2\ln J)`                  Deshpande et al. (2022),
                                                                    Eq. (Neo-Hookean)
quadratic    :math:`\lambda/2\,(J - 1)^2`                           AceFEM's element library
===========  =====================================================  =========================

Both terms have U(1) = U'(1) = 0 and U''(1) = λ, so they agree for small strains. In two dimensions
the state is plane strain: F is completed by :math:`F_{33} = 1`, so that
:math:`I_c = \operatorname{tr}(F^T F) + 1` and J is the determinant of the in-plane part.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import ufl
from pydantic import Field

from datagen.quantities import Modulus
from shared_schema.common.configuration import Frozen

Volumetric = Literal["paper", "quadratic"]

Expression = Any  # a UFL expression; ufl has no types


class NeoHookean(Frozen):
    """Compressible Neo-Hookean solid.

    Attributes
    ----------
    young_modulus : float
        Young's modulus E in Pa, positive.
    poisson_ratio : float
        Poisson's ratio ν, above -1 and below 0.5.
    volumetric : {"paper", "quadratic"}
        Name of the volumetric term U(J).
    """

    young_modulus: Modulus
    poisson_ratio: float = Field(gt=-1, lt=0.5)
    volumetric: Volumetric = "paper"

    @property
    def lame_lambda(self) -> float:
        """First Lamé parameter λ = Eν / ((1 + ν)(1 − 2ν)) in Pa."""
        e, nu = self.young_modulus, self.poisson_ratio
        return e * nu / ((1 + nu) * (1 - 2 * nu))

    @property
    def lame_mu(self) -> float:
        """Shear modulus μ = E / (2(1 + ν)) in Pa."""
        return self.young_modulus / (2 * (1 + self.poisson_ratio))


def volumetric_paper(j: Expression, lam: Expression) -> Expression:
    """U(J) = λ/4 (J² − 1 − 2 ln J)."""
    return lam / 4 * (j**2 - 1 - 2 * ufl.ln(j))


def volumetric_quadratic(j: Expression, lam: Expression) -> Expression:
    """U(J) = λ/2 (J − 1)²."""
    return lam / 2 * (j - 1) ** 2


VOLUMETRIC_TERMS: dict[Volumetric, Callable[[Expression, Expression], Expression]] = {
    "paper": volumetric_paper,
    "quadratic": volumetric_quadratic,
}


def deformation_gradient(u: Expression) -> Expression:
    """Deformation gradient F = I + ∇u, (d, d), of a displacement u with d components."""
    return ufl.Identity(len(u)) + ufl.grad(u)


def strain_energy(
    f: Expression, lam: Expression, mu: Expression, volumetric: Volumetric
) -> Expression:
    """Strain energy density W(F) = μ/2 (I_c − 3 − 2 ln J) + U(J) in J/m³.

    Parameters
    ----------
    f : UFL tensor, (d, d)
        Deformation gradient; d = 2 means plane strain (F₃₃ = 1).
    lam, mu : UFL scalars
        Lamé parameters in Pa.
    volumetric : {"paper", "quadratic"}
        Name of U(J).
    """
    j = ufl.det(f)
    out_of_plane = 3 - f.ufl_shape[0]  # F₃₃² = 1 in plane strain, nothing in 3D
    i_c = ufl.tr(f.T * f) + out_of_plane
    return mu / 2 * (i_c - 3 - 2 * ufl.ln(j)) + VOLUMETRIC_TERMS[volumetric](j, lam)
