"""Units of a case, as labels: numbers are kept as they are given, and written with their unit.

All numbers of a case are in one consistent set, a stress in force over length squared. Its labels
are metres and newtons unless the case has others under ``units``; nothing is converted by them.
Lengths are written in a unit that leaves few zeros: a node that moves by 0.4 m moves by 400 mm, and
one that moves by 2e-7 m by 0.2 µm.

Numbers in a case file have types with bounds that any sensible case keeps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared_schema.common.configuration import Frozen

GUIDANCE = """\
Units are SI: m, N, Pa, s. In two dimensions the body is 1 m thick, so forces are per metre of
thickness. Any other consistent set of units works too, since nothing is converted: a mesh in mm
needs stresses in MPa; forces are then in N, displacements and errors in mm, `--tolerance` is in mm,
and a plane body is 1 mm thick. `units: {length: mm, force: N}` in the case labels datasets,
figures, pages and messages; without it they say m, N and Pa. Use the same set for a case and all
its networks. A mesh in mm with stresses in Pa describes a body that is a thousand times too large,
whose displacements are far too small, which is warned of; `mesh.scale: 0.001` makes it metres.
"""
PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
LENGTHS = {**{p + "m": PREFIXES[p] for p in ("n", "µ", "m", "", "k")}, "um": 1e-6, "cm": 1e-2}
FORCES = {**{p + "N": PREFIXES[p] for p in ("n", "µ", "m", "", "k", "M")}, "uN": 1e-6}
LENGTHS_SHOWN = ("nm", "µm", "mm", "m", "km")
FEWEST, MOST = 1e-3, 1e3  # numbers that are written in the usual unit
MOST_DRAWN = 1e6  # and at an axis, where longer numbers do no harm
PATTERN = r"^[^\s\"'<>&{}$\\%#_^~,;:|`]{1,12}$"


class Units(Frozen):
    """Labels of the units of a case; nothing is converted.

    Attributes
    ----------
    length : str
        Unit of coordinates and displacements, such as mm.
    force : str
        Unit of forces, such as N; stresses are in force over length squared, such as MPa.
    """

    length: str = Field("m", pattern=PATTERN)
    force: str = Field("N", pattern=PATTERN)

    @classmethod
    def of_case(cls, case: Mapping[str, Any]) -> Units:
        """Take those of a case configuration; metres and newtons, if it names none."""
        return cls.model_validate(case.get("units") or {})

    @property
    def stress(self) -> str:
        """Unit of stresses, stiffnesses and pressures."""
        return self._product("Pa", -2) or f"{self.force}/{self.length}²"

    @property
    def energy(self) -> str:
        """Unit of energies."""
        return self._product("J", 1) or f"{self.force}·{self.length}"

    @property
    def labels(self) -> dict[str, str]:
        """Units by quantity, as a manifest has them."""
        return {"length": self.length, "force": self.force, "stress": self.stress, "time": "s"}

    def named(self, unit: str) -> str:
        """Label of the SI unit m, m³, N, Pa, J or N/m; others stay."""
        labels = {
            "m³": f"{self.length}³",
            "m": self.length,
            "N": self.force,
            "Pa": self.stress,
            "J": self.energy,
        }
        return labels.get(unit, f"{self.force}/{self.length}" if unit == "N/m" else unit)

    def written(self, length: float) -> str:
        """Write a length with its unit, such as 0.2 µm; metres from 0.001 to 999 mm in mm."""
        unit, factor = self.fitting(length)
        return f"{length * factor:.3g} {unit}"

    def fitting(self, length: float, most: float = MOST) -> tuple[str, float]:
        """Unit that a length is written in, and the factor from the unit of the case to it.

        The usual unit is that of the case, millimetres for metres. Beyond `most` of it, it is the
        longest one that leaves a digit before the point; below 0.001 of it, the longest one that
        leaves one of the first three behind it.

        Parameters
        ----------
        length : float
        most : float
            Millimetres, or usual units of the case, from which on a longer unit is taken.
        """
        usual = "mm" if self.length == "m" else self.length
        if self.length not in LENGTHS:
            return usual, 1.0
        size = abs(length) * LENGTHS[self.length]
        if not FEWEST <= size / LENGTHS[usual] < most and 0 < size < float("inf"):
            least = 1.0 if size >= LENGTHS[usual] else FEWEST
            fit = [unit for unit in LENGTHS_SHOWN if size >= least * LENGTHS[unit]]
            usual = fit[-1] if fit else LENGTHS_SHOWN[0]
        return usual, LENGTHS[self.length] / LENGTHS[usual]

    def drawn(self, *lengths: NDArray[np.float64]) -> tuple[str, float]:
        """Unit of an axis or colour bar for all these lengths, and the factor to it."""
        return self.fitting(max(np.abs(x).max(initial=0.0) for x in lengths), MOST_DRAWN)

    def _product(self, unit: str, exponent: int) -> str | None:
        """Unit of force times a power of length, with a prefix; None if there is none."""
        if self.length not in LENGTHS or self.force not in FORCES:
            return None
        factor = FORCES[self.force] * LENGTHS[self.length] ** exponent
        for prefix, value in PREFIXES.items():
            if abs(factor / value - 1) < 1e-9:
                return prefix + unit
        return None


SI = Units()


LARGEST_SEED = 2**63 - 1
LARGEST_MAGNITUDE = 1e12
LARGEST_LENGTH = 1e9

Length = Annotated[float, Field(ge=-LARGEST_LENGTH, le=LARGEST_LENGTH)]  # m, also a coordinate
Size = Annotated[float, Field(ge=1e-9, le=1e9)]  # m, of a body or a part of it
Magnitude = Annotated[float, Field(ge=-LARGEST_MAGNITUDE, le=LARGEST_MAGNITUDE)]  # N, or Pa
Count = Annotated[int, Field(gt=0, le=10**9)]
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED)]
