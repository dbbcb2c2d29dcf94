"""A user's own materials: a strain energy of the invariants, in a file of the user.

A case names a class of such a file as ``model: path/to/file.py:ClassName``; the path is relative to
the case file. The file is code and runs with the user's rights, when a case file is read. Datasets
and run folders hold the operations of its energy (`shared_schema.materials.recorded_energy`), and a
`RecordedMaterial` is what has these: nothing imports the file when they are read.
"""

from __future__ import annotations

import inspect
from abc import ABC
from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import Field, model_validator
from pydantic.json_schema import SkipJsonSchema

from shared_schema.common.configuration import absent
from shared_schema.materials.at_rest import AtRest
from shared_schema.materials.fibres import WithFibres
from shared_schema.materials.recorded_energy import RecordedEnergy, recorded
from shared_schema.materials.signature import Functions, Invariants, Scalar
from shared_schema.own_class import described, source_of

Found = TypeVar("Found")
SHA256 = r"^[0-9a-f]{64}$"


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
    recorded : RecordedEnergy, optional
        Operations of `energy`, filled in when a case is read.
    """

    model_sha256: str | None = Field(None, pattern=SHA256)
    recorded: SkipJsonSchema[RecordedEnergy | None] = Field(None, exclude_if=absent, repr=False)

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
        return _of_the_file(self, super().at_rest)


def with_record(material: OwnMaterial) -> OwnMaterial:
    """Copy a material with the operations of its energy.

    Raises
    ------
    ValueError
        If the energy cannot be recorded; the message has the line of the user's file.
    """
    try:
        record = _of_the_file(material, lambda: recorded(material.energy, material.family_count))
    except ValueError as error:
        raise ValueError(f"key 'model' = '{material.model}': energy: {error}") from None
    return material.model_copy(update={"recorded": record})


def _of_the_file(material: OwnMaterial, done: Callable[[], Found]) -> Found:
    """Do what calls a material's energy; ValueError with the line of the user's file."""
    try:
        return done()
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        raise ValueError(described(error, source_of(material))) from None


class RecordedMaterial(WithFibres):
    """A user's own material as datasets have it: its energy is a record of operations.

    Attributes
    ----------
    model : str
        ``FILE.py:ClassName``, which is not imported.
    model_sha256 : str
        Checksum of that file.
    recorded : RecordedEnergy
        The energy; the values of the class's own keys are in it.
    """

    model_sha256: str = Field(pattern=SHA256)
    recorded: RecordedEnergy = Field(repr=False)

    @model_validator(mode="before")
    @classmethod
    def _without_keys_of_its_own(cls, content: Any) -> Any:
        """Leave the keys of the user's class aside."""
        if not isinstance(content, dict):
            return content
        if "recorded" not in content:
            raise ValueError(
                f"key 'model' = '{content.get('model')}': the dataset is of an earlier version, "
                "which has no record of its energy; make it again"
            )
        return {key: value for key, value in content.items() if key in cls.model_fields}

    def energy(self, c: Invariants, of: Functions) -> Scalar:
        """W in J per m³, by the recorded operations."""
        return self.recorded(c, of)

    @property
    def family_range(self) -> tuple[int, int]:
        """The recorded number of families."""
        return (self.recorded.families,) * 2
