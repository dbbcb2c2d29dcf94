"""A user's own energy, of soft tissue that stiffens exponentially."""

from __future__ import annotations

from shared_schema import OwnMaterial
from shared_schema.materials import Functions, Invariants, Scalar


class Fung(OwnMaterial):
    """W = μ/(2 a) (exp(a (Ī₁ − 3)) − 1) + K/2 (J − 1)²; μ and K in Pa."""

    shear: float
    bulk: float
    stiffening: float

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        first = c.j ** (-2 / 3) * c.i1 - 3
        tissue = self.shear / (2 * self.stiffening) * (of.exp(self.stiffening * first) - 1)
        return tissue + self.bulk / 2 * (c.j - 1) ** 2
