r"""The law of a material: its energy and the derivatives, by what the deformation is measured with.

The measures of a deformation gradient F are

.. math:: I_1 = |F|^2, \quad I_2 = |\mathrm{cof} F|^2, \quad J = \det F, \quad θ, \quad
          I_4 = |F a|^2, \quad K_4 = |\mathrm{cof}(F) \, a|^2

of three dimensions, with the last two for every family of fibres along a. Plane strain has
:math:`F_{33} = 1`, so that :math:`I_2 = I_1 - 1 + J^2` is none of its own. Where an element finds
a dilation θ by itself (`surrogate.mechanics.solids.solid`), the energy is that of
:math:`\bar F = (θ / J)^{1/d} F`, whose measures are

.. math:: \bar I_1 = r^2 I_1, \quad \bar I_2 = r^4 I_2, \quad \bar J = θ, \quad
          \bar I_4 = r^2 I_4, \quad \bar K_4 = r^4 K_4, \quad r = (θ / J)^{1/3}

in space; in the plane :math:`\bar I_1 - 1 = r^2 (I_1 - 1)` and :math:`\bar K_4 = r^2 K_4` with
:math:`r = (θ / J)^{1/2}`. So it is a function of the measures of F and of θ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations_with_replacement

import sympy  # type: ignore[import-untyped]

from shared_schema.materials import FibreInvariants, Invariants, Material, Scalar
from surrogate.mechanics.energy.tape import Tape, Values, positive

FIRST, SECOND, VOLUME, DILATION, FIBRES = range(5)  # numbers of I₁, I₂, J, θ, and of the first I₄


class Symbolic:
    """Functions of SymPy's expressions (`shared_schema.materials.Functions`)."""

    def ln(self, x: Scalar, /) -> Scalar:
        """Natural logarithm."""
        return sympy.log(x)

    def exp(self, x: Scalar, /) -> Scalar:
        """Exponential function."""
        return sympy.exp(x)

    def positive(self, x: Scalar, /) -> Scalar:
        """Return max(x, 0)."""
        return positive(x)


@dataclass(frozen=True)
class Law:
    """Energy of one material as tapes of its measures.

    Attributes
    ----------
    count : int
        Number m of the measures: I₁, I₂, J, θ, then I₄ and K₄ of every family.
    stress : Tape
        Derivatives by the measures, in Pa: m outputs.
    energy : Tape
        The energy in J/m³, then these derivatives, then the second ones, (a, b) with a ≤ b in
        lexical order.
    """

    count: int
    stress: Tape
    energy: Tape

    @cached_property
    def families(self) -> int:
        """Number of the families of fibres."""
        return (self.count - FIBRES) // 2

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Measures (a, b) of the second derivatives."""
        return list(combinations_with_replacement(range(self.count), 2))

    @property
    def at_rest(self) -> list[float]:
        """Measures of the undeformed body."""
        return [3.0, 3.0, *[1.0] * (self.count - 2)]

    @cached_property
    def energy_at_rest(self) -> float:
        """Energy of the undeformed body in J/m³."""
        return float(self.energy(self.at_rest)[0])

    def second(self, outputs: Sequence[Values]) -> dict[tuple[int, int], Values]:
        """Second derivatives that are not zero, of the outputs of `energy`."""
        found = zip(self.pairs, outputs[1 + self.count :], strict=True)
        return {pair: value for pair, value in found if not is_zero(value)}


def is_zero(value: Values) -> bool:
    """Whether a value is the number zero, for any measures."""
    return isinstance(value, float) and value == 0


@cache
def law_of(material: Material, dimension: int, projected: bool = False) -> Law:
    """Differentiate the energy of a material.

    Parameters
    ----------
    material : Material
    dimension : int
        d.
    projected : bool
        Whether the element finds θ by itself.
    """
    families = material.family_count
    names = "I1 I2 J theta" + "".join(f" I4_{i} K4_{i}" for i in range(families))
    measures = sympy.symbols(names, positive=True)
    i1, i2, j, dilation, *of_fibres = measures
    stretches, areas = of_fibres[::2], of_fibres[1::2]
    if dimension == 2:
        i2 = i1 - 1 + j**2
    if projected:
        squared = (dilation / j) ** sympy.Rational(2, dimension)  # r²
        i1 = squared * i1 if dimension == 3 else squared * (i1 - 1) + 1
        i2 = squared**2 * i2 if dimension == 3 else i1 - 1 + dilation**2
        stretches = [squared * each for each in stretches]
        areas = [squared ** (dimension - 1) * each for each in areas]
        j = dilation
    fibres = tuple(map(FibreInvariants, stretches, areas))
    energy = sympy.sympify(material.energy(Invariants(i1, i2, j, fibres), Symbolic()))
    first = [sympy.diff(energy, measure) for measure in measures]
    pairs = combinations_with_replacement(range(len(measures)), 2)
    second = [sympy.diff(first[a], measures[b]) for a, b in pairs]
    count = len(measures)
    law = Law(count, Tape.of(first, measures), Tape.of([energy, *first, *second], measures))
    if projected or families:
        return law
    # What rounding errors leave of the energy and stress of the undeformed body is taken from them.
    rest, by_i1, by_i2, by_j, *_ = law.energy(law.at_rest)
    left = float(2 * by_i1 + (4 * by_i2 if dimension == 3 else 0.0) + by_j)
    whole = law.energy.shifted(0, -float(rest)).shifted(1 + VOLUME, -left)
    return Law(count, law.stress.shifted(VOLUME, -left), whole)
