"""The material of a body, as a case configuration and a run's description name it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen

Volumetric = Literal["paper", "quadratic"]


class NeoHookean(Frozen):
    """Compressible Neo-Hookean solid.

    Attributes
    ----------
    young_modulus : float
        Young's modulus E in Pa, positive.
    poisson_ratio : float
        Poisson's ratio ν, above -1 and below 0.5.
    volumetric : {"paper", "quadratic"}
        Name of the volumetric term U(J): λ/4 (J² − 1 − 2 ln J), or λ/2 (J − 1)².
    """

    young_modulus: float = Field(ge=1e-12, le=1e18)
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
