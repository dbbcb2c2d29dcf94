"""Materials with fibres: their directions, the layers of an artery's wall, the heart's muscle."""

from __future__ import annotations

import math
from abc import ABC
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr, field_validator

from shared_schema.common.configuration import Frozen, absent
from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import sha256
from shared_schema.materials.isotropic import RubberLike, first_invariant
from shared_schema.materials.material import (
    LARGEST_MODULUS,
    Functions,
    Invariants,
    Material,
    Scalar,
)

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
