"""Base of all materials: a strain energy, and what follows from it."""

from __future__ import annotations

from abc import ABC, abstractmethod

from pydantic import Field, model_validator

from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import first_line
from shared_schema.materials.at_rest import AtRest, at_rest
from shared_schema.materials.signature import Functions, Invariants, Scalar

LARGEST_MODULUS = 1e18  # Pa


class Material(Frozen, ABC):
    """A hyperelastic material; its attributes are the keys of a case's ``material`` section.

    Attributes
    ----------
    model : str
        Name of the model, or ``FILE.py:ClassName`` of a user's own one.
    group : str or None
        Physical group of the cells that are of this material, if a body has several.
    """

    model: str
    group: str | None = Field(None, min_length=1, exclude_if=absent)

    @abstractmethod
    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W in J per m³ of the undeformed body.

        Parameters
        ----------
        c : Invariants
            Of C and of the fibres; the isotropic ones are `c.i1`, `c.i2` and `c.j`.
        of : Functions
            `of.ln`, `of.exp` and `of.positive`; other functions are not known to all that is put
            in (`shared_schema.materials.signature`).
        """

    @property
    def family_count(self) -> int:
        """Number of families of fibres."""
        return 0

    def _key_problem(self) -> str | None:
        """Say which key is wrong beside the others, before the energy is evaluated."""
        return None

    def at_rest(self) -> AtRest:
        """Stress and stiffness of the undeformed body, from the energy."""
        return at_rest(self.energy, self.family_count)

    @property
    def lame_mu(self) -> float:
        """Shear modulus μ of the undeformed body in Pa; with fibres, of the stiffest shear."""
        return self.at_rest().shear_modulus

    @property
    def lame_lambda(self) -> float:
        """First Lamé parameter λ = K − 2/3 μ of the undeformed body in Pa."""
        rest = self.at_rest()
        return rest.bulk_modulus - 2 / 3 * rest.shear_modulus

    @model_validator(mode="after")
    def _is_a_solid_at_rest(self) -> Material:
        if (problem := self._key_problem()) is not None:
            raise ValueError(problem)
        try:
            problem = self.at_rest().problem()
        except (ArithmeticError, ValueError) as error:
            problem = f"energy: {first_line(error)}"
        if problem is not None:
            known = {"model", "model_sha256", "group", "recorded"}
            keys = ", ".join(f"{key} = {value}" for key, value in self if key not in known)
            raise ValueError(f"key 'model' = '{self.model}': {problem} ({keys})")
        return self
