r"""What is given of an actuator, and the equation that its amplitude solves.

An actuator is a load of one amplitude a, which works on a quantity q
(`shared_schema.common.bodies.following_loads`). Given is one number v:

=========  =======  =============================================  ====================
kind       of       given                                          equation h(a, q) = 0
=========  =======  =============================================  ====================
tension    cable    T in N                                         a − v
length     cable    the longest ℓ in m; a slack cable is shorter   a ≥ 0, q ≤ v,
                                                                   a (q − v) = 0
pressure   chamber  p in Pa beyond the ambient one                 a − v
volume     chamber  V in m³ of an incompressible fluid             q − v
gas        chamber  pressure v in Pa that the gas would have in    (A + a) q
                    the chamber at rest, beyond the ambient one    − (A + v) V₀
=========  =======  =============================================  ====================

The gas keeps its temperature. A is the ambient pressure, V₀ the volume at rest; the amount of gas,
pressure times volume, is :math:`(A + v) V_0`, and v = 0 is a chamber that was closed at rest. From
rest, the load factor s leads from :math:`v_0` to v, with :math:`v_0 = q_0` of lengths and volumes,
else 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from shared_schema.common.units import Units

KINDS = {  # by what is given: unit, and what an actuator of this kind is
    "tension": ("N", "cable"),
    "length": ("m", "cable"),
    "pressure": ("Pa", "chamber"),
    "volume": ("m³", "chamber"),
    "gas": ("Pa", "chamber"),
}
UNITS = {  # names and units of amplitude and quantity
    "cable": (("tension", "N"), ("length", "m")),
    "chamber": (("pressure", "Pa"), ("volume", "m³")),
}
AMPLITUDES = ("tension", "pressure")  # that are given themselves


class Equation(NamedTuple):
    """h without unit, or in that of the amplitude where this is given, and its derivatives."""

    value: float
    by_amplitude: float
    by_quantity: float
    by_given: float


@dataclass(frozen=True)
class Control:
    """What is given of one actuator in one load case.

    Attributes
    ----------
    kind : str
        Of `KINDS`.
    value : float
        v, in the unit of the kind.
    rest : float
        Length or volume at rest in m or m³.
    ambient : float
        A in Pa, of a gas.
    """

    kind: str
    value: float
    rest: float
    ambient: float = 0.0

    @property
    def gives_amplitude(self) -> bool:
        """True if tension or pressure are given."""
        return self.kind in AMPLITUDES

    @property
    def at_rest(self) -> float:
        """The value v₀ of the body at rest."""
        return self.rest if self.kind in ("length", "volume") else 0.0

    @property
    def rests(self) -> bool:
        """True if the actuator does nothing to a body at rest."""
        if self.kind == "length":
            return self.value >= self.rest
        return self.value == self.at_rest

    def target(self, load_factor: float) -> float:
        """v₀ + s (v − v₀)."""
        return self.at_rest + load_factor * (self.value - self.at_rest)

    def equation(
        self, load_factor: float, amplitude: float, quantity: float, stiffness: float = 1.0
    ) -> Equation:
        """h(a, q) at a load factor, relative to the body at rest.

        Parameters
        ----------
        load_factor, amplitude, quantity : float
            s, a and q.
        stiffness : float
            Of lengths: a positive number in N/m. A cable is taut where
            :math:`a + stiffness · (q - v) > 0`, which holds for every one in a solution.
        """
        target = self.target(load_factor)
        if self.kind == "gas":
            amount = (self.ambient + target) * self.rest
            scale = max(self.ambient, abs(self.value), 1e-300) * self.rest
            whole = self.ambient + amplitude
            value = (whole * quantity - amount) / scale
            by_given = -load_factor * self.rest / scale
            return Equation(value, quantity / scale, whole / scale, by_given)
        taut = amplitude + stiffness * (quantity - target) > 0
        if self.kind == "volume" or (self.kind == "length" and taut):
            value = (quantity - target) / self.rest
            return Equation(value, 0.0, 1 / self.rest, -load_factor / self.rest)
        if self.gives_amplitude:
            return Equation(amplitude - target, 1.0, 0.0, -load_factor)
        return Equation(amplitude, 1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Actuated:
    """An actuator in equilibrium.

    Attributes
    ----------
    of : {"cable", "chamber"}
    amplitude : float
        Tension in N, or pressure in Pa.
    quantity : float
        Length in m, or volume in m³.
    """

    of: str
    amplitude: float
    quantity: float

    def written(self, units: Units) -> str:
        """Say both with their units."""
        values = zip(UNITS[self.of], (self.amplitude, self.quantity), strict=True)
        return ", ".join(
            f"{name} {value:.6g} {units.named(unit)}" for (name, unit), value in values
        )


def pressed(pressures: Iterable[float]) -> tuple[Control, ...]:
    """Controls of given pressures in Pa."""
    return tuple(Control("pressure", float(pressure), rest=1.0) for pressure in pressures)
