r"""Stresses at some states and their changes: the product with the tangent, of any elements.

.. math::
    δP = \frac{∂P}{∂F} : H + \frac{∂^2 W}{∂F ∂θ} δθ + δp \, \mathrm{cof} F, \qquad
    δθ = Π (\mathrm{cof} F : H), \quad
    δp = Π \left(\frac{∂^2 W}{∂θ ∂F} : H + \frac{∂^2 W}{∂θ^2} δθ\right)

with the moduli of `surrogate.mechanics.solids.deformation` and the projection Π of
`surrogate.mechanics.solids.solid`, where the elements have one. The derivatives of the energy by
its measures are those of the state, so that every direction H takes a few sums only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from shared_schema.common.bodies.polar_decomposition import library_of
from surrogate.mechanics.energy.law import DILATION, VOLUME, Law
from surrogate.mechanics.solids.deformation import Deformation, Values, plus
from surrogate.mechanics.solids.solid import Points


class Elements(Protocol):
    """What stresses need to know of the elements of a body; cells are the axis -3 of all fields."""

    projects: bool

    @property
    def laws(self) -> Sequence[Law]:
        """Law of every material."""

    @property
    def members(self) -> Sequence[Any]:
        """Cells of every material, if there are several."""

    def joined(self, parts: Sequence[Any], /) -> Any:
        """Fields of the cells of all materials as one of all cells."""

    def projected(self, values: Any, /) -> Any:
        """Π of values at the points."""


class Stresses:
    """P at some states, and its changes: of tensors, or of arrays.

    Parameters
    ----------
    elements : Elements
        Such as a `Solid`.
    points : Points
        F, and θ if the elements find it.

    Attributes
    ----------
    f, stress : Tensor, (d, d, n_cells, …)
        F, and P in Pa, no meaning where a cell is inverted.
    inside : Tensor of bool, (n_cells, …)
        Whether J and θ are positive and finite.
    """

    def __init__(self, elements: Elements, points: Points) -> None:
        self._elements = elements
        self.f: Values = points.f
        self._parts = [
            _Part(points if some is None else points.of(some), law, some)
            for some, law in zip(elements.members or [None], elements.laws, strict=True)
        ]
        if elements.projects:
            slopes = [part.of_points(part.first[DILATION]) for part in self._parts]
            pressure = elements.projected(elements.joined(slopes))
            for part in self._parts:
                part.first[VOLUME] = part.first[VOLUME] + part.of(pressure)
        self.inside = elements.joined([part.state.inside for part in self._parts])
        self.stress = elements.joined([part.state.stress(part.first) for part in self._parts])

    @property
    def energy(self) -> Values:
        """W at the points in J/m³, from rest on: (n_cells, …)."""
        return self._elements.joined([part.of_points(part.energy) for part in self._parts])

    def change(self, h: Values) -> Values:
        """δP in Pa along H: (d, d, n_cells, …) → same."""
        return self.changes([h])[0]

    def changes(self, directions: Sequence[Values]) -> list[Values]:
        """δP of several H, with one projection of all of them."""
        elements, parts = self._elements, self._parts
        of = [[part.of(h) for part in parts] for h in directions]
        dilations: list[Any] = [None] * len(of)
        if elements.projects:
            volumes = [
                [part.along(VOLUME, x) for part, x in zip(parts, some, strict=True)] for some in of
            ]
            dilations = self._projected(volumes)
        changes = [
            [
                part.changes(x, None if dilation is None else part.of(dilation))
                for part, x in zip(parts, some, strict=True)
            ]
            for some, dilation in zip(of, dilations, strict=True)
        ]
        if elements.projects:
            slopes = [
                [part.of_points(x[DILATION]) for part, x in zip(parts, some, strict=True)]
                for some in changes
            ]
            for some, pressure in zip(changes, self._projected(slopes), strict=True):
                for part, x in zip(parts, some, strict=True):
                    x[VOLUME] = x.get(VOLUME, 0.0) + part.of(pressure)
        return [
            elements.joined(
                [part.stress(h, x) for part, h, x in zip(parts, some, others, strict=True)]
            )
            for some, others in zip(of, changes, strict=True)
        ]

    def _projected(self, values: Sequence[Sequence[Values]]) -> list[Values]:
        """Π of several fields at once, one after the other on the axis of states."""
        fields = [self._elements.joined(some) for some in values]
        if len(fields) == 1:
            return [self._elements.projected(fields[0])]
        together = self._elements.projected(library_of(fields[0]).concatenate(fields, axis=-2))
        count = fields[0].shape[-2]
        return [together[..., i * count : (i + 1) * count, :] for i in range(len(fields))]


class _Part:
    """The points of one material."""

    def __init__(self, points: Points, law: Law, cells: Any) -> None:
        self.state: Deformation = points.state(law)
        self._cells = cells
        outputs = law.energy(self.state.measures, library_of(points.f))
        self.energy = outputs[0] - law.energy_at_rest
        self.first: list[Values] = outputs[1 : 1 + law.count]
        self._second = law.second(outputs)
        numbers = {n for pair in self._second for n in pair} | {VOLUME}
        self._derivatives = {n: self.state.derivative(n) for n in numbers if n != DILATION}

    def of(self, field: Values) -> Values:
        """The part of a field of all cells."""
        return field if self._cells is None else field[..., self._cells, :, :]

    def of_points(self, values: Values) -> Values:
        """Values, or a number, as a field: (n_cells, …)."""
        return 0 * self.state.j + values

    def along(self, number: int, h: Values) -> Values:
        """Change of a measure, ∂m/∂F : H."""
        return (self._derivatives[number] * h).sum((0, 1))

    def changes(self, h: Values, dilation: Values | None = None) -> dict[int, Values]:
        """Changes δψ_a of the derivatives at fixed p, of those that change."""
        of_measures = {} if dilation is None else {DILATION: dilation}
        found: dict[int, Values] = {}
        for (a, b), factor in self._second.items():
            for x, y in {(a, b), (b, a)}:
                if y not in of_measures:
                    of_measures[y] = self.along(y, h)
                part = factor * of_measures[y]
                found[x] = found[x] + part if x in found else part
        return found

    def stress(self, h: Values, changes: dict[int, Values]) -> Values:
        """δP by the changes of the derivatives."""
        total = self.state.turned(h, self.first)
        for number, factor in changes.items():
            if number != DILATION:
                total = plus(total, factor, self._derivatives[number])
        return total
