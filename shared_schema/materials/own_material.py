"""Base class of a user's own materials: a strain energy of the invariants, in a file of the user.

A case names such a class as ``model: path/to/file.py:ClassName``; the path is relative to the case
file. The file is code and runs with the user's rights, when a case file is read.
"""

from __future__ import annotations

import inspect
from abc import ABC

from pydantic import Field

from shared_schema.materials.at_rest import AtRest
from shared_schema.materials.fibres import WithFibres
from shared_schema.own_class import described, source_of


class OwnMaterial(WithFibres, ABC):
    """A material of a user's own; its attributes are the keys of a case's ``material`` section.

    Attributes
    ----------
    model : str
        Name of the class in the case file.
    model_sha256 : str, optional
        Checksum of the file, filled in when a case is read, so that a dataset belongs to one
        version of the file.
    fibres : direction, list of directions, or FibreFile
        Of a class that says how many families its energy takes, ``families = 1`` or, from fewest to
        most, ``families = 1, 2``; `c.fibres` has the invariants of each.
    """

    model_sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")

    def at_rest(self) -> AtRest:
        """Stress and stiffness of the undeformed body.

        Raises
        ------
        ValueError
            If the method `energy` raises an error, or returns anything but a scalar; the message
            has the line of the user's file.
        """
        if len(inspect.signature(self.energy).parameters) != 2:
            raise ValueError(
                "expected the arguments (self, c, of): invariants (c.i1, c.i2, c.j, c.fibres) and "
                "functions (of.ln, of.exp, of.positive)"
            )
        try:
            return super().at_rest()
        except MemoryError:
            raise
        except (Exception, SystemExit) as error:
            raise ValueError(described(error, source_of(self))) from None
