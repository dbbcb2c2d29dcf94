"""Actuators as a case file has them: cables and chambers by their names.

.. code-block:: yaml

    actuators:
      left: {cable: [{fixed: [0, 0, 0.01]}, [0.05, 0, 0.01], [0.1, 0, 0.01]], tension: [0, 5]}
      top: {chamber: cavity, pressure: [0, 2.0e4]}

Of each, one number is given in a load case (`shared_schema.actuators.control`), in a dataset drawn
uniformly between limits. An actuator that a command does not name is a slack cable, or a chamber
at ambient pressure.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, Field, ValidationError, model_validator

from shared_schema.actuators.control import KINDS
from shared_schema.common.configuration import Frozen, absent, first_problem
from shared_schema.common.units import Length, Magnitude

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
MOST = 100  # actuators


def _ascending(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] >= value[1]:
        raise ValueError("expected [low, high] with low < high")
    return value


def _positive(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] <= 0:
        raise ValueError("expected numbers above 0")
    return value


def _pulling(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] < 0:
        raise ValueError("expected tensions of 0 at least, a cable cannot push")
    return value


Limits = Annotated[tuple[Magnitude, Magnitude], AfterValidator(_ascending)]
Positive = Annotated[Limits, AfterValidator(_positive)]
Pulls = Annotated[Limits, AfterValidator(_pulling)]
Place = Annotated[tuple[Length, ...], Field(min_length=2, max_length=3)]


class FixedPoint(Frozen):
    """A point of a cable that does not move.

    Attributes
    ----------
    fixed : tuple of 2 or 3 floats
        Where it is, in m, inside of the body or outside.
    """

    fixed: Place


class Actuator(Frozen):
    """Base of cables and chambers; one number of each is given, between limits."""

    kinds: ClassVar[tuple[str, ...]]

    @model_validator(mode="after")
    def _has_one_kind(self) -> Actuator:
        given = [kind for kind in self.kinds if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of {', '.join(self.kinds)}")
        return self

    @property
    def kind(self) -> str:
        """What is given."""
        return next(kind for kind in self.kinds if getattr(self, kind) is not None)

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of what is given."""
        found: tuple[float, float] = getattr(self, self.kind)
        return found


class Cable(Actuator):
    """A cable through the body, without friction, straight from point to point.

    Attributes
    ----------
    cable : tuple of points
        Places in m, in order. Those in the body move with it; one outside of it is written
        ``{fixed: [X, Y, Z]}`` and does not move.
    tension : tuple of 2 floats, optional
        (low, high) of the tension in N.
    length : tuple of 2 floats, optional
        (low, high) of the length in m, which the cable never exceeds.
    """

    kinds: ClassVar[tuple[str, ...]] = ("tension", "length")

    cable: tuple[Place | FixedPoint, ...] = Field(min_length=2, max_length=1000)
    tension: Pulls | None = Field(None, exclude_if=absent)
    length: Positive | None = Field(None, exclude_if=absent)


class Chamber(Actuator):
    """A cavity of the body that is closed.

    Attributes
    ----------
    chamber : str
        Group of the facets that bound it.
    pressure : tuple of 2 floats, optional
        (low, high) of the pressure in Pa beyond the ambient one; below it if negative.
    volume : tuple of 2 floats, optional
        (low, high) of the volume in m³ of an incompressible fluid.
    gas : tuple of 2 floats, optional
        (low, high) of the amount of a gas: of the pressure in Pa, beyond the ambient one, that it
        would have in the chamber at rest.
    ambient : float, optional
        Pressure around the body in Pa, with `gas`; 101325 is that of the air.
    """

    kinds: ClassVar[tuple[str, ...]] = ("pressure", "volume", "gas")

    chamber: str
    pressure: Limits | None = Field(None, exclude_if=absent)
    volume: Positive | None = Field(None, exclude_if=absent)
    gas: Limits | None = Field(None, exclude_if=absent)
    ambient: float | None = Field(None, ge=0, le=1e12, exclude_if=absent)

    @model_validator(mode="after")
    def _has_gas(self) -> Chamber:
        if self.gas is not None and self.ambient is None:
            raise ValueError("key 'ambient': expected the pressure around the body, with 'gas'")
        if self.gas is not None and self.gas[0] <= -(self.ambient or 0.0):
            raise ValueError(f"key 'gas' = {self.gas}: expected more than -ambient, no gas at all")
        return self


def actuator_of(content: Any) -> Actuator:
    """Build an actuator from plain data; ValueError that names the key if it is none."""
    if isinstance(content, Actuator):
        return content
    if not isinstance(content, dict) or ("cable" in content) == ("chamber" in content):
        raise ValueError("expected a mapping with 'cable' or 'chamber'")
    try:
        return (Cable if "cable" in content else Chamber).model_validate(content)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from None


def actuators_of(content: Any) -> dict[str, Actuator]:
    """Build the actuators of a case from plain data, in the order of their names.

    Raises
    ------
    ValueError
        If one is wrong, with the key.
    """
    if not isinstance(content, dict) or len(content) > MOST:
        raise ValueError(f"expected a mapping of names to actuators, at most {MOST}")
    found = {}
    for name in sorted(map(str, content)):
        if not NAME.fullmatch(name) or name in KINDS:
            raise ValueError(
                f"'{name}': expected a name of letters, digits, _ and -, and none of "
                f"{', '.join(KINDS)}"
            )
        try:
            found[name] = actuator_of(content[name])
        except ValueError as error:
            before, key, rest = str(error).partition("key '")
            is_key = key and before in ("", "unknown ")
            said = f"{before}{key}{name}.{rest}" if is_key else f"'{name}': {error}"
            raise ValueError(said) from None
    return found
