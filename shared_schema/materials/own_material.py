r"""A user's own materials: a strain energy of the invariants, in a file of the user.

A case names a class of such a file as ``model: path/to/file.py:ClassName``; the path is relative to
the case file. The file is code and runs with the user's rights, when a case file is read. Datasets
and run folders hold the operations of its energy, and a `RecordedMaterial` is what has these:
nothing imports the file when they are read.

An energy is a fixed list of operations on the invariants (`shared_schema.materials.material`), so
that numbers which write down what is done with them record all of it. Datasets hold this record,
and what reads them repeats the operations, on numbers, tensors or symbols: no code of the user is
run.

============  ==================
operation     value
============  ==================
``sum``       a + b
``scale``     c a
``shift``     a + c
``product``   a b
``power``     :math:`a^c`
``exp``       exp a
``ln``        ln a
``positive``  max(a, 0)
============  ==================

with the values a and b of two slots, and a number c. The first slots are :math:`I_1, I_2, J`, then
:math:`I_4` and :math:`K_4` of every family of fibres; every operation fills the next one.
"""

from __future__ import annotations

import inspect
from abc import ABC
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import Field, FiniteFloat, model_validator
from pydantic.json_schema import SkipJsonSchema

from shared_schema.common.configuration import Frozen, absent
from shared_schema.materials.fibre_reinforced import WithFibres
from shared_schema.materials.material import (
    JETS,
    Arithmetic,
    AtRest,
    FibreInvariants,
    Functions,
    Invariants,
    Scalar,
)
from shared_schema.own_class import described, source_of

MOST = 10_000  # operations; Ogden's of two terms has 663
ISOTROPIC = 3  # I₁, I₂, J
Name: TypeAlias = Literal["sum", "scale", "shift", "product", "power", "exp", "ln", "positive"]
Slot: TypeAlias = Annotated[int, Field(ge=0, le=2 * MOST)]
Operation: TypeAlias = tuple[Name, Slot, Slot, FiniteFloat]


class RecordedEnergy(Frozen):
    """Operations of an energy; the value of the last one is the energy.

    Attributes
    ----------
    families : int
        Number of families of fibres.
    operations : tuple of (name, a, b, c)
        The slots a and b, and the number c; those that an operation does not take are 0.
    """

    families: int = Field(ge=0, le=2)
    operations: tuple[Operation, ...] = Field(min_length=1, max_length=MOST)

    @model_validator(mode="after")
    def _takes_what_is_there(self) -> RecordedEnergy:
        inputs = ISOTROPIC + 2 * self.families
        for number, (name, a, b, _) in enumerate(self.operations):
            if max(a, b) >= inputs + number:
                raise ValueError(f"operation {number} ({name}): expected slots that are filled")
        return self

    def __call__(self, c: Invariants, of: Functions) -> Scalar:
        """The energy of some invariants, as `Material.energy`."""
        slots = [c.i1, c.i2, c.j]
        for family in c.fibres:
            slots += [family.stretch, family.area]
        for name, a, b, number in self.operations:
            x, constant = slots[a], int(number) if number.is_integer() else number
            if name == "sum":
                slots.append(x + slots[b])
            elif name == "product":
                slots.append(x * slots[b])
            elif name == "scale":
                slots.append(constant * x)
            elif name == "shift":
                slots.append(x + constant)
            elif name == "power":
                slots.append(x**constant)
            else:
                slots.append(getattr(of, name)(x))
        return slots[-1]


def recorded(energy: Callable[[Invariants, Functions], Scalar], families: int) -> RecordedEnergy:
    """Record the operations of an energy.

    Raises
    ------
    TypeError
        If the energy does with its invariants what none of these operations is.
    ValueError
        If it does none, or too many.
    """
    record = _Record(ISOTROPIC + 2 * families)
    i1, i2, j, *of_fibres = (_Number(record, slot) for slot in range(record.inputs))
    pairs = zip(of_fibres[::2], of_fibres[1::2], strict=True)
    found = energy(Invariants(i1, i2, j, tuple(FibreInvariants(*p) for p in pairs)), record)
    if not isinstance(found, _Number):
        raise ValueError("the energy does not depend on the invariants")
    record.end_with(found)
    return RecordedEnergy(families=families, operations=tuple(record.rows))


class _Record:
    """Writes down operations, equal ones once; it is what an energy has as `of`."""

    def __init__(self, inputs: int) -> None:
        self.inputs, self.rows = inputs, list[Operation]()
        self._known: dict[Operation, _Number] = {}

    def add(self, name: Name, a: _Number, b: int = 0, c: float = 0.0) -> _Number:
        """Write an operation down, unless it is."""
        row = (name, a.slot, b, float(c))
        if row not in self._known:
            if len(self.rows) == MOST:
                raise ValueError(f"the energy has more than {MOST} operations")
            self._known[row] = _Number(self, self.inputs + len(self.rows))
            self.rows.append(row)
        return self._known[row]

    def end_with(self, found: _Number) -> None:
        """Let the last operation be the one of this number."""
        if found.slot < self.inputs or not self.rows:
            self.add("scale", found, c=1.0)
            return
        del self.rows[found.slot - self.inputs + 1 :]

    def ln(self, x: Scalar, /) -> Scalar:
        """Natural logarithm."""
        return self.add("ln", x) if isinstance(x, _Number) else JETS.ln(x)

    def exp(self, x: Scalar, /) -> Scalar:
        """Exponential function."""
        return self.add("exp", x) if isinstance(x, _Number) else JETS.exp(x)

    def positive(self, x: Scalar, /) -> Scalar:
        """Return max(x, 0)."""
        return self.add("positive", x) if isinstance(x, _Number) else JETS.positive(x)


class _Number(Arithmetic):
    """A number whose operations are written down."""

    def __init__(self, record: _Record, slot: int) -> None:
        self.record, self.slot = record, slot

    def __add__(self, other: Scalar) -> _Number:
        if isinstance(other, _Number):
            return self.record.add("sum", self, other.slot)
        return self.record.add("shift", self, c=other)

    def __mul__(self, other: Scalar) -> _Number:
        if isinstance(other, _Number):
            return self.record.add("product", self, other.slot)
        return self.record.add("scale", self, c=other)

    def __pow__(self, exponent: float) -> _Number:
        return self.record.add("power", self, c=exponent)


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
