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

from dataclasses import dataclass
from functools import cache, cached_property

from shared_schema.materials import FibreInvariants, Invariants, Material
from surrogate.mechanics.energy.recording import Operation, Recording, Value
from surrogate.mechanics.energy.tape import Tape, tape_of

FIRST, SECOND, VOLUME, DILATION, FIBRES = range(5)  # numbers of I₁, I₂, J, θ, and of the first I₄


@dataclass(frozen=True)
class Law:
    """Energy of one material, recorded.

    Attributes
    ----------
    recording : Recording
        Of the m measures: I₁, I₂, J, θ, then I₄ and K₄ of every family.
    outputs : list of Value
        The energy in J/m³, and its derivatives by the measures in Pa.
    """

    recording: Recording
    outputs: list[Value]

    @property
    def count(self) -> int:
        """Number m of the measures."""
        return self.recording.count

    @cached_property
    def energy(self) -> Tape:
        """The outputs."""
        return tape_of(self.recording, self.outputs)

    @cached_property
    def stress(self) -> Tape:
        """The derivatives."""
        return tape_of(self.recording, self.outputs[1:])

    @cached_property
    def families(self) -> int:
        """Number of the families of fibres."""
        return (self.count - FIBRES) // 2

    @cached_property
    def is_smooth(self) -> bool:
        """Whether nothing begins or ends to bear, such as fibres that bear tension alone."""
        return all(code != Operation.STEP for code, *_ in self.recording.rows)

    @property
    def at_rest(self) -> list[float]:
        """Measures of the undeformed body."""
        return [3.0, 3.0, *[1.0] * (self.count - 2)]

    @cached_property
    def energy_at_rest(self) -> float:
        """Energy of the undeformed body in J/m³."""
        return float(self.energy(self.at_rest)[0])


@cache
def law_of(material: Material, dimension: int, projected: bool = False) -> Law:
    """Record the energy of a material, and its derivatives.

    Parameters
    ----------
    material : Material
    dimension : int
        d.
    projected : bool
        Whether the element finds θ by itself.
    """
    count = FIBRES + 2 * material.family_count
    recording = Recording(count)
    i1, i2, j, dilation, *of_fibres = recording.inputs
    stretches, areas = of_fibres[::2], of_fibres[1::2]
    if dimension == 2:
        i2 = i1 - 1 + j**2
    if projected:
        squared = (dilation / j) ** (2 / dimension)  # r²
        i1 = squared * i1 if dimension == 3 else squared * (i1 - 1) + 1
        i2 = squared**2 * i2 if dimension == 3 else i1 - 1 + dilation**2
        stretches = [squared * each for each in stretches]
        areas = [squared ** (dimension - 1) * each for each in areas]
        j = dilation
    fibres = tuple(map(FibreInvariants, stretches, areas))
    energy = material.energy(Invariants(i1, i2, j, fibres), recording)
    first = recording.gradient(energy)
    if not (projected or material.family_count):
        # What rounding errors leave of the energy and stress of the undeformed body is taken away.
        at_rest = [3.0, 3.0, 1.0, 1.0]
        rest, by_i1, by_i2, by_j, _ = tape_of(recording, [energy, *first])(at_rest)
        energy = energy - float(rest)
        left = 2 * by_i1 + (4 * by_i2 if dimension == 3 else 0.0) + by_j
        first[VOLUME] = first[VOLUME] - float(left)
    return Law(recording, [energy, *first])
