"""The key `fibres` of a material: directions in the undeformed body, of one or more families."""

from __future__ import annotations

import math
from abc import ABC
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, field_validator

from shared_schema.common.checksum import sha256
from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError, first_line
from shared_schema.materials.material import Material

LARGEST = 1e9  # of a component; only the direction counts
Component = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Direction: TypeAlias = tuple[Component, ...]


class FibreFile(Frozen):
    """Directions of every cell, from a file of NumPy.

    Attributes
    ----------
    file : str
        Path of a ``.npy`` file relative to the case file: (n_cells, families, d), or (n_cells, d)
        for one family, in the order of the cells of the case's mesh.
    sha256 : str, optional
        Checksum of the file. It is filled in when a case is read, so that a dataset belongs to one
        version of the file.
    """

    file: str = Field(min_length=1)
    sha256: str | None = Field(None, pattern=r"^[0-9a-f]{64}$")
    _folder: Path = PrivateAttr(default=Path())

    def found_from(self, folder: Path) -> FibreFile:
        """Copy this with its path resolved against `folder` and its checksum filled in.

        Raises
        ------
        ValueError
            If there is no such file, or its checksum differs from the given one.
        """
        path = folder / self.file
        if not path.is_file():
            raise ValueError(f"key 'fibres.file' = '{self.file}': no such file {path}")
        digest = sha256(path)
        if self.sha256 not in (None, digest):
            raise ValueError(f"key 'fibres.sha256' = {self.sha256!r}: {path} has {digest}")
        found = self.model_copy(update={"sha256": digest})
        found._folder = folder
        return found

    def read(self) -> NDArray[np.float64]:
        """Read the directions, (n_cells, families, d).

        Raises
        ------
        InputError
            If it is no such file.
        """
        path = self._folder / self.file
        try:
            values = np.load(path, allow_pickle=False)
            found = np.asarray(values, dtype=np.float64)
        except (OSError, ValueError, TypeError, EOFError) as error:
            raise InputError(
                f"key 'fibres.file' = '{self.file}': cannot be read ({first_line(error)})"
            ) from None
        return found[:, None] if found.ndim == 2 else found


Fibres: TypeAlias = tuple[Direction, ...] | FibreFile


class WithFibres(Material, ABC):
    """Base of materials that can have families of fibres.

    Attributes
    ----------
    fibres : direction, list of directions, or FibreFile
        Direction of each family in the undeformed body, a vector of any length but 0; or a file
        that has those of every cell.
    """

    families: ClassVar[int | tuple[int, int]] = 0  # number of families, or fewest and most

    fibres: Fibres | None = Field(None, exclude_if=absent)

    @field_validator("fibres", mode="before")
    @classmethod
    def _is_one_form(cls, value: Any) -> Any:
        """Build the form that is meant, so that an error is about that one."""
        if isinstance(value, dict):
            return FibreFile.model_validate(value)
        is_absent = value is None and not cls.model_fields["fibres"].is_required()
        if is_absent or isinstance(value, FibreFile):
            return value
        vectors = value if isinstance(value, tuple) else ()
        if vectors and not any(isinstance(each, tuple) for each in vectors):
            vectors = (vectors,)
        if not vectors or not all(_is_vector(each) for each in vectors):
            raise ValueError("expected a vector, one for each family, or {file: FILE.npy}")
        return tuple(tuple(float(x) for x in each) for each in vectors)

    def _key_problem(self) -> str | None:
        """Say that another number of families is expected, or that one has no direction."""
        fewest, most = self.family_range
        count = 0 if self.fibres is None else self.family_count
        if not fewest <= count <= most:
            expected = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            return f"key 'fibres': found {count} directions, expected {expected}"
        for vector in self.fibres if isinstance(self.fibres, tuple) else ():
            if not math.hypot(*vector) > 0:
                return f"key 'fibres': the vector {list(vector)} has no direction"
        return None

    @property
    def family_range(self) -> tuple[int, int]:
        """Fewest and most families that the energy takes."""
        families = self.families
        return families if isinstance(families, tuple) else (families, families)

    @property
    def family_count(self) -> int:
        """Number of families; the most that the energy takes, if a file has the directions."""
        if isinstance(self.fibres, FibreFile):
            return self.family_range[1]
        return 0 if self.fibres is None else len(self.fibres)


def _is_vector(value: Any) -> bool:
    """True for two or three numbers, none too large."""
    return (
        isinstance(value, tuple)
        and len(value) in (2, 3)
        and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in value)
        and all(-LARGEST <= x <= LARGEST for x in value)
    )


class FibreReinforced(WithFibres, ABC):
    """Base of shipped materials with fibres; `fibres` must be given."""

    fibres: Fibres
