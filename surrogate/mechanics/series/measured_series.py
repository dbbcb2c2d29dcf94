r"""Power series of the stress of any material on a path of deformations, term by term.

.. math::
    F = I + \sum_k s^k H_k, \quad \mathrm{cof} F = \sum_k s^k C_k, \quad
    J = \sum_k s^k J_k, \quad P = \sum_k s^k P_k

With the cross product of tensors (`surrogate.mechanics.solids.deformation`) and :math:`H_0 = I`,

.. math::
    C_k = \tfrac12 \sum_{j=0}^k H_j × H_{k-j}, \qquad
    k J_k = \sum_{j=1}^k j \, C_{k-j} : H_j.

Sums of such products give the other measures of the deformation, and the tape of the energy's law
(`surrogate.mechanics.energy.tape`) its derivatives :math:`ψ_a`: every coefficient follows from
those before it, whatever the energy is. All depend on :math:`H_k` linearly, by their derivatives at
rest. So the part of :math:`P_k` that follows from the terms before is that with :math:`H_k = 0`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from surrogate.mechanics.energy.law import DILATION, FIBRES, FIRST, SECOND, VOLUME, Law
from surrogate.mechanics.energy.tape import RULES, Operation
from surrogate.mechanics.solids.deformation import cross
from surrogate.mechanics.solids.solid import Solid

Coefficient = Tensor | None  # None is zero


class SeriesOfLaw:
    """Terms of the stress in Pa at points of one material: tensors (d, d, …), scalars (…).

    Parameters
    ----------
    law : Law
    dimension : int
        d.
    fibres : sequence of Tensors (d, …)
        Unit directions of the families of the law.
    """

    def __init__(self, law: Law, dimension: int, fibres: Sequence[Tensor] = ()) -> None:
        self.law, self.d, self.fibres = law, dimension, fibres
        tape = law.stress
        self.rest = [float(value) for value in tape.slots(law.at_rest)]
        self.slopes = slopes_at_rest(law)
        self.used = used_measures(law)
        self.h: list[Tensor] = []  # H₁, H₂, …
        self.c: list[Tensor] = []
        self.x: list[Tensor] = []  # of cof F × F
        self.pressure: list[Coefficient] = []
        self.slots: list[list[Coefficient]] = []  # of every order, from 1 on
        self._gains: list[Coefficient] = []

    def begin(self, like: Tensor) -> Tensor:
        """Set the measures of the next order as if H were zero, and return J: (…).

        Parameters
        ----------
        like : Tensor, (d, d, …)
            Of the shape of H.
        """
        k, zero = len(self.h) + 1, torch.zeros_like(like)
        c = zero
        if self.d == 3:
            for j in range(1, k // 2 + 1):
                part = cross(self.h[j - 1], self.h[k - j - 1])
                c = c + (part / 2 if 2 * j == k else part)
        volume = zero[0, 0]
        for j in range(1, k):
            volume = volume + (j / k) * contraction(self.h[j - 1], self.c[k - j - 1])
        measures: list[Coefficient] = [None] * self.law.count
        measures[VOLUME] = volume
        if FIRST in self.used:
            measures[FIRST] = convolution(self.h, self.h, k)
        if SECOND in self.used:
            measures[SECOND] = 2 * trace(c) + convolution(self.c, self.c, k)
            x = trace_minus(c)
            for j in range(1, k):
                x = x + cross(self.c[j - 1], self.h[k - j - 1])
            self.x.append(x)
        self.c.append(c)
        self.h.append(zero)
        for family, a in enumerate(self.fibres):
            stretched, area = self._along(self.h, a), self._along(self.c, a)
            measures[FIBRES + 2 * family] = products(stretched, k)
            measures[FIBRES + 2 * family + 1] = products(area, k)
        self.slots.append(measures)
        return volume

    @staticmethod
    def _along(series: Sequence[Tensor], a: Tensor) -> list[Tensor]:
        """Terms of a series of tensors that begins with I, times a direction: (d, …) each."""
        return [a, *((term * a).sum(1) for term in series)]

    def scalars(self, dilation: Coefficient) -> Coefficient:
        """Run the tape for the next order, with θ; return ∂ψ/∂θ."""
        k, slots = len(self.h), self.slots
        slots[-1][DILATION] = dilation
        for code, left, right, constant in self.law.stress.rows:
            slots[-1].append(self._coefficient(k, code, left, right, constant))
        return self._output(DILATION, k)

    def stress(self, pressure: Coefficient) -> Tensor:
        """P of the next order without H, with the pressure of this order."""
        k = len(self.h)
        self.pressure.append(pressure)
        total = torch.zeros_like(self.h[-1])
        first, second, volume = (self._series(a, k) for a in (FIRST, SECOND, VOLUME))
        unit = sum_of(times(2, first[k]), times(4, second[k]), volume[k])
        if unit is not None:
            total = add_multiple(total, unit)
        for j in range(1, k + 1):
            total = add_product(total, first[k - j], self.h[j - 1], 2)
            total = add_product(total, volume[k - j], self.c[j - 1])
            if self.x:
                total = add_product(total, second[k - j], self.x[j - 1], 2)
        for family, a in enumerate(self.fibres):
            total = total + self._of_fibres(family, a, k)
        return total

    def _of_fibres(self, family: int, a: Tensor, k: int) -> Tensor:
        """What a family adds to P of the next order: ψ₄ 2 F a ⊗ a + ψ_K 2 F × (cof F a ⊗ a)."""
        stretch, area = (self._series(FIBRES + 2 * family + i, k) for i in (0, 1))
        total = torch.zeros_like(self.h[-1])
        stretched = self._along(self.h, a)
        for j in range(k + 1):
            total = add_product(total, stretch[k - j], stretched[j][:, None] * a, 2)
        dyads = [each[:, None] * a for each in self._along(self.c, a)]
        crossed = []
        for n in range(k + 1):  # terms of F × (cof F a ⊗ a)
            term = trace_minus(dyads[n] + torch.zeros_like(total))
            for j in range(1, n + 1) if self.d == 3 else ():
                term = term + cross(self.h[j - 1], dyads[n - j] + torch.zeros_like(total))
            crossed.append(term)
        for j in range(k + 1):
            total = add_product(total, area[k - j], crossed[j], 2)
        return total

    def complete(self, h: Tensor, dilation: Coefficient) -> None:
        """Set H of the order that was begun, and what θ gains by it."""
        of_h = trace(h)
        self.h[-1] = h
        self.c[-1] = self.c[-1] + trace_minus(h)
        if self.x:  # cof(H) × I + I × H
            self.x[-1] = self.x[-1] + trace_minus(trace_minus(h)) + trace_minus(h)
        gains: list[Coefficient] = [2 * of_h, 4 * of_h, of_h, dilation]
        for a in self.fibres:
            along = (a * (h * a).sum(1)).sum(0)
            gains += [2 * along, 2 * (of_h * (a * a).sum(0) - along)]
        self._gains, slots = gains, self.slots[-1]
        for number, slopes in enumerate(self.slopes):
            for slope, gain in zip(slopes, gains, strict=True):
                if slope and gain is not None:
                    slots[number] = sum_of(slots[number], slope * gain)

    def pressure_gain(self) -> Tensor:
        """What ∂ψ/∂θ of the order that was completed gains by H."""
        total: Coefficient = None
        slot = int(self.law.stress.outputs[DILATION])
        for slope, gain in zip(self.slopes[slot], self._gains, strict=True) if slot >= 0 else ():
            total = sum_of(total, None if gain is None else times(slope, gain))
        return torch.zeros_like(self.h[-1][0, 0]) if total is None else total

    def _series(self, measure: int, k: int) -> list[Any]:
        """ψ_a of the orders 0 to k, with the pressure in that by J: a number, then coefficients."""
        found: list[Any] = [self._at_rest(measure)]
        found += [self._output(measure, order) for order in range(1, k + 1)]
        if measure == VOLUME:
            found[0] += self._at_rest(DILATION)
            for order, pressure in enumerate(self.pressure, 1):
                found[order] = sum_of(found[order], pressure)
        return found

    def _at_rest(self, measure: int) -> float:
        slot = int(self.law.stress.outputs[measure])
        return float(self.law.stress.fixed[measure]) if slot < 0 else self.rest[slot]

    def _output(self, measure: int, order: int) -> Coefficient:
        slot = int(self.law.stress.outputs[measure])
        return None if slot < 0 else self.slots[order - 1][slot]

    def _coefficient(
        self, k: int, code: Operation, left: int, right: int, constant: float
    ) -> Coefficient:
        """The k-th coefficient of a result: `surrogate.mechanics.energy.tape`."""
        rule, new, rest = RULES[code], self.slots[k - 1], self.rest
        place = len(new)  # of the result
        by_left, by_right = rule.slopes(rest[left], rest[right], rest[place], constant)
        total = sum_of(times(by_left, new[left]), times(by_right, new[right]))
        if rule.weight is None:
            return total
        other = right if code == Operation.PRODUCT else place
        for j in range(1, k):
            part = product(self.slots[j - 1][left], self.slots[k - j - 1][other])
            total = sum_of(total, times(rule.weight(j, k, rest[left], constant), part))
        return total


def slopes_at_rest(law: Law) -> list[list[float]]:
    """Derivatives of all slots of the stress tape by the measures, at rest."""
    rest = [float(value) for value in law.stress.slots(law.at_rest)]
    found = [[float(a == b) for b in range(law.count)] for a in range(law.count)]
    for code, left, right, constant in law.stress.rows:
        slopes = RULES[code].slopes(rest[left], rest[right], rest[len(found)], constant)
        of_left, of_right = slopes
        found.append(
            [of_left * x + of_right * y for x, y in zip(found[left], found[right], strict=True)]
        )
    return found


def used_measures(law: Law) -> set[int]:
    """Measures that a derivative of the energy depends on, or is one by."""
    tape = law.stress
    used = set(tape.left.tolist()) | set(tape.right.tolist()) | set(tape.outputs.tolist())
    used |= {a for a in range(law.count) if tape.outputs[a] >= 0 or tape.fixed[a]} - {FIRST}
    return {a for a in used if 0 <= a < law.count}


def contraction(a: Tensor, b: Tensor) -> Tensor:
    """A : B, (d, d, …) twice → (…)."""
    return (a * b).sum((0, 1))


def trace(a: Tensor) -> Tensor:
    """Tr A: (d, d, …) → (…)."""
    total = a[0, 0] + a[1, 1]
    return total if len(a) == 2 else total + a[2, 2]


def trace_minus(a: Tensor) -> Tensor:
    """(tr A) I - Aᵀ, that is I × A: (d, d, …) → same."""
    return add_multiple(-a.transpose(0, 1), trace(a))


def add_multiple(a: Tensor, factor: Tensor) -> Tensor:
    """A + x I: (d, d, …), (…) → (d, d, …)."""
    found = a.clone()
    for i in range(len(a)):
        found[i, i] += factor
    return found


def convolution(a: Sequence[Tensor], b: Sequence[Tensor], k: int) -> Tensor:
    """Σ A_j : B_{k-j}, 1 ≤ j < k, of lists that begin with the order 1."""
    return sum(
        (contraction(a[j - 1], b[k - j - 1]) for j in range(1, k)),
        start=torch.zeros_like(a[0][0, 0]) if a else torch.zeros(()),
    )


def products(terms: Sequence[Tensor], k: int) -> Tensor:
    """Term k of |x|², of terms of a series of vectors from order 0 on: (d, …) → (…)."""
    return sum(
        ((terms[j] * terms[k - j]).sum(0) for j in range(1, k + 1)),
        start=(terms[0] * terms[k]).sum(0),
    )


def sum_of(*parts: Coefficient) -> Coefficient:
    """Sum of coefficients of which some are zero."""
    given = [part for part in parts if part is not None]
    return sum(given[1:], start=given[0]) if given else None


def times(factor: float, a: Coefficient) -> Coefficient:
    """A multiple."""
    return None if a is None or factor == 0 else a if factor == 1 else factor * a


def product(a: Coefficient, b: Coefficient) -> Coefficient:
    """A product."""
    return None if a is None or b is None else a * b


def add_product(
    total: Tensor, factor: Coefficient | float, a: Tensor, times_: float = 1.0
) -> Tensor:
    """Total + x A of a factor that may be a number or none."""
    if factor is None or (isinstance(factor, float) and factor == 0):
        return total
    return total + (times_ * factor) * a


class SeriesOfBody:
    """Terms of the stress of a body, of one law after the other.

    Parameters
    ----------
    solid : Solid
    """

    def __init__(self, solid: Solid) -> None:
        self.solid, d = solid, solid.gradients.shape[3]
        self._laws = []
        for number, law in enumerate(solid.laws):
            fibres: list[Tensor] = []
            if solid.fibres is not None and law.families:
                of_law = solid.fibres[: law.families]
                fibres = list(of_law[:, :, solid.members[number]] if solid.members else of_law)
            self._laws.append(SeriesOfLaw(law, d, fibres))
        self._begun = False

    def add(self, h: Tensor) -> None:
        """Set the next H, (d, d, n_cells, N, n_points)."""
        parts = self._parts(h)
        if not self._begun:
            self._begin(parts)
        self._begun = False
        gains = self._projected([trace(part) for part in parts])
        for law, part, gain in zip(self._laws, parts, gains, strict=True):
            law.complete(part, gain)
        more = self._projected([law.pressure_gain() for law in self._laws])
        for law, gain in zip(self._laws, more, strict=True):
            law.pressure[-1] = sum_of(law.pressure[-1], gain)

    def next_stress(self) -> Tensor:
        """The next P without what is linear in H, likewise."""
        return self.solid.joined(self._begin([torch.zeros_like(law.h[-1]) for law in self._laws]))

    def _begin(self, like: Sequence[Tensor]) -> list[Tensor]:
        self._begun, laws = True, self._laws
        volumes = [law.begin(part) for law, part in zip(laws, like, strict=True)]
        slopes = []
        for law, dilation in zip(laws, self._projected(volumes), strict=True):
            slope = law.scalars(dilation)
            slopes.append(torch.zeros_like(law.h[-1][0, 0]) if slope is None else slope)
        pressures = self._projected(slopes)
        return [law.stress(pressure) for law, pressure in zip(laws, pressures, strict=True)]

    def _projected(self, parts: Sequence[Tensor]) -> list[Coefficient]:
        """Π of scalars of every law; nothing if the elements have none."""
        if not self.solid.projects:
            return [None] * len(parts)
        return list(self._parts(self.solid.projected(self.solid.joined(parts))))

    def _parts(self, field: Tensor) -> list[Tensor]:
        """The part of every law of a field (…, n_cells, N, n_points)."""
        members = self.solid.members
        return [field[..., some, :, :] for some in members] if members else [field]
