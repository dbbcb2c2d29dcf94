"""Base class of a user's own materials: a strain energy W(F), written in UFL.

A case names such a class as ``model: path/to/file.py:ClassName``; the path is relative to the case
file. The file is code and runs with the user's rights, when a case file is read.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from pydantic import Field

from shared_schema.material import Material


class OwnMaterial(Material, ABC):
    """A hyperelastic material; its attributes are the keys of a case's ``material`` section.

    Attributes
    ----------
    model : str
        Name of the class in the case file.
    model_sha256 : str, optional
        Checksum of the file, filled in when a case is read, so that a dataset belongs to one
        version of the file.
    """

    model_sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")

    @abstractmethod
    def energy(self, f: Any) -> Any:
        """Strain energy density W(F) in J per m³ of the undeformed body.

        Parameters
        ----------
        f : UFL tensor, (3, 3)
            Deformation gradient; in plane strain F₃₃ = 1. W(I) may have any value, but the
            undeformed body must be free of stress.

        Returns
        -------
        UFL scalar
        """
