r"""Stresses on a path of deformations, F(s) = Σ sᵏ Fₖ: term by term, of any material and element.

.. math::
    P(s) = \sum_k s^k P_k, \qquad θ = Π J, \quad p = Π \frac{∂W}{∂θ}

with the projection Π of `surrogate.mechanics.solids.solid`, where the elements have one. P₀ is the
stress of a state, and P₁ its derivative along F₁, the product with the tangent. From the undeformed
body on, the terms are those of its load series: P_k depends on F_k linearly, and the part of it
that follows from the terms before is that with F_k = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from surrogate.mechanics.energy.law import DILATION, VOLUME
from surrogate.mechanics.energy.power_series import Coefficient, Given, Series, Spherical
from surrogate.mechanics.solids.deformation import Deformation

if TYPE_CHECKING:
    from surrogate.mechanics.solids.solid import Solid


class StressPath:
    """W and P on a path; fields are (…, m, n_cells, N, n_points), of m paths from one state.

    Parameters
    ----------
    solid : Solid
    start : Tensor, (d, d, 1, n_cells, N, n_points), optional
        F₀; that of the undeformed body by default.
    """

    def __init__(self, solid: Solid, start: Tensor | None = None) -> None:
        unit = solid.identity[:, :, None]
        self._solid, self._given = solid, Given(Spherical(1.0, unit) if start is None else start)
        volumes: list[Series] = []
        slopes: list[Series] = []
        dilation, pressure = (_projection(solid, self._given, of) for of in (volumes, slopes))
        self._states: list[Deformation] = []
        self._energies: list[Series] = []
        self._stresses: list[Series] = []
        for number, law in enumerate(solid.laws):
            f, fibres = _part(solid, self._given.series(), number), None
            if solid.fibres is not None and law.families:
                some = solid.members[number] if solid.members else slice(None)
                fibres = solid.fibres[: law.families, :, None, some]
            state = Deformation(
                f, _part(solid, dilation, number) if solid.projects else None, fibres
            )
            energy, *first = law.energy(state.measures)
            if solid.projects:
                volumes.append(state.j)
                slopes.append(first[DILATION])
                first[VOLUME] = _part(solid, pressure, number) + first[VOLUME]
            self._states.append(state)
            self._energies.append(energy + -law.energy_at_rest)
            self._stresses.append(state.stress(first))

    @property
    def inside(self) -> Tensor:
        """Whether J and θ of the first state are positive and finite: (1, n_cells, N, n_points)."""
        return self._solid.joined([state.inside for state in self._states])

    @property
    def energy(self) -> Tensor:
        """W in J/m³, from rest on, of the first state, without meaning where it is not inside."""
        return self._solid.joined([energy.term(0) for energy in self._energies])

    @property
    def stress(self) -> Tensor:
        """P in Pa of the first state, likewise."""
        return self._stress(0)

    def along(self, h: Tensor) -> Tensor:
        """δP in Pa along m directions: (d, d, m, n_cells, N, n_points) → same."""
        self._given.set(1, h)
        return self._stress(1)

    def add(self, h: Tensor) -> None:
        """Set the next term of F, of one path."""
        self._given.set(len(self._given.terms), h)

    def next_stress(self) -> Tensor:
        """The next term of P without what is linear in that of F."""
        return self._stress(len(self._given.terms))

    def _stress(self, k: int) -> Tensor:
        last = self._given.terms[-1]
        fields = []
        for number, stress in enumerate(self._stresses):
            found, like = stress.term(k), _some(self._solid, last, number)
            fields.append(found if isinstance(found, Tensor) else found + 0 * like)
        return self._solid.joined(fields)


def _some(solid: Solid, field: Coefficient, number: int) -> Coefficient:
    """The part of a law of a field of all cells."""
    if not solid.members or not isinstance(field, Tensor):
        return field
    return field[..., solid.members[number], :, :]


def _part(solid: Solid, series: Series, number: int) -> Series:
    """The same of series."""
    return series.mapped(lambda of: _some(solid, of, number)) if solid.members else series


def _projection(solid: Solid, given: Given, parts: Sequence[Series]) -> Series:
    """Π of scalars of every law, as one of all cells."""
    counts = [len(some) for some in solid.members] or [len(solid.cells)]

    def coefficient(_: Series, k: int) -> Coefficient:
        terms = [part.term(k) if isinstance(part, Series) else part * (k == 0) for part in parts]
        like = next((term for term in terms if isinstance(term, Tensor)), None)
        if like is None:
            return terms[0]  # Π of the number 1 is 1
        shape = like.shape[0], -1, *like.shape[2:]
        fields = [
            term
            if isinstance(term, Tensor)
            else torch.full_like(like[:, :1], term).expand(shape[0], count, *shape[2:])
            for term, count in zip(terms, counts, strict=True)
        ]
        field = solid.joined(fields)
        found = solid.projected(field.movedim(0, 1).flatten(1, 2))
        return found.reshape(len(found), len(field), -1, found.shape[2]).movedim(1, 0)

    return Series(given, coefficient)
