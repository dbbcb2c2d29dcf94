r"""Laws of materials as programs: sums of products, in the order in which loops compute them.

Operations of a recorded law (`surrogate.mechanics.solids.recorded_law`) that only add and multiply
are merged, so that a result is

.. math:: y = \sum_t f_t \, a_t \, b_t

with numbers f and slots a and b, of which slot 0 is the number 1; all others are functions of one
slot. The programs of all materials of a body stand one after the other in one table, so that one
compiled loop runs any of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.energy.recording import COMMUTATIVE, Recording
from surrogate.mechanics.energy.tape import Operation

Numbers = NDArray[np.int64]
Doubles = NDArray[np.float64]
SUM, POWER, EXP, LN, STEP = (
    int(code)
    for code in (Operation.SUM, Operation.POWER, Operation.EXP, Operation.LN, Operation.STEP)
)
ONE = 0  # the slot of the number 1
RecordedLaw = tuple[Recording, dict[str, Any]]  # and its outputs
Terms = dict[tuple[int, int], float]  # factors of the products of two slots


class Programs(NamedTuple):
    """Programs of all materials, with the same inputs.

    Attributes
    ----------
    inputs : int
        Number of the first slots: 1, F, directions of fibres, and θ and p of some elements.
    slots : int
        Largest number of slots.
    most : int
        Largest number of products of a result, and one more.
    first : array of int, (n_laws + 1,)
        First result of every law.
    codes : array of int, (n,)
        Operation of every result; sums of products are `SUM`.
    starts : array of int, (n + 1,)
        First product of every result.
    left, right, factors : array, (n_products,)
        Of a function, the slot that it takes, and a constant.
    outputs : array of int, (n_laws, n_outputs)
        Slots.
    kept : array of int, (n_laws, n_kept)
        Slots whose lower orders the higher ones depend on, the inputs first, filled up with 0.
    """

    inputs: int
    slots: int
    most: int
    first: Numbers
    codes: Numbers
    starts: Numbers
    left: Numbers
    right: Numbers
    factors: Doubles
    outputs: Numbers
    kept: Numbers

    @classmethod
    def of(cls, laws: Sequence[RecordedLaw], beside: int, wanted: Sequence[str]) -> Programs:
        """Make the programs of some laws, of outputs by their names, one after the other.

        Parameters
        ----------
        laws : sequence of tuple
            As `surrogate.mechanics.solids.recorded_law` records them.
        beside : int
            Number of the last inputs of all, θ and p: 0 or 2.
        wanted : sequence of str
        """
        inputs = 1 + max(recording.count for recording, _ in laws)
        written = [_Program(*law, inputs, beside, wanted) for law in laws]
        counts = [len(each.rows) for each in written]
        rows = [row for each in written for row in each.rows]
        terms = [term for _, of_row in rows for term in of_row]
        most = max(len(each.kept) for each in written)
        return cls(
            inputs,
            inputs + max(counts),
            max(len(of_row) for _, of_row in rows) + 1,
            np.cumsum([0, *counts]),
            np.array([code for code, _ in rows], np.int64),
            np.cumsum([0, *(len(of_row) for _, of_row in rows)]),
            np.array([term[0] for term in terms], np.int64),
            np.array([term[1] for term in terms], np.int64),
            np.array([term[2] for term in terms], np.float64),
            np.array([each.outputs for each in written], np.int64),
            np.array([np.pad(each.kept, (0, most - len(each.kept))) for each in written], np.int64),
        )


class _Program:
    """The program of one law: rows of a code and terms (left, right, factor)."""

    def __init__(
        self,
        recording: Recording,
        of: dict[str, Any],
        inputs: int,
        beside: int,
        wanted: Sequence[str],
    ) -> None:
        self.inputs = inputs
        found = [int(slot) for name in wanted for slot in recording.slots_of(of[name]).ravel()]
        given = [*range(1, 1 + recording.count - beside), *range(inputs - beside, inputs)]
        self._recording, self._uses = recording, _uses(recording, found)
        self._place = dict(enumerate(given))  # of recorded slots
        self._sums: dict[int, Terms] = {}  # of those that are sums of products
        self.rows: list[tuple[int, list[tuple[int, int, float]]]] = []
        for slot, (code, a, b, c) in enumerate(recording.rows, start=recording.count):
            if self._uses[slot]:
                self._sum(slot, code, a, b, c)
        self.outputs = [self._written(slot) for slot in found]
        operands = {
            slot
            for place, (code, terms) in enumerate(self.rows, start=self.inputs)
            for a, b, _ in terms
            for slot in ([a, b] if ONE not in (a, b) else [])
            + ([a, place] if code not in (SUM, STEP) else [])
        }
        own = sorted(slot for slot in operands if slot >= self.inputs)
        self.kept = np.array([*range(1, self.inputs), *own])

    def _sum(self, slot: int, code: Operation, a: int, b: int, c: float) -> None:
        """Know the terms of a slot, or write a function."""
        if code == Operation.SUM:
            self._sums[slot] = _added(self._terms(a), self._terms(b))
        elif code == Operation.SCALE:
            self._sums[slot] = {pair: c * factor for pair, factor in self._terms(a).items()}
        elif code == Operation.SHIFT:
            self._sums[slot] = _added(self._terms(a), {(ONE, ONE): c})
        elif code == Operation.PRODUCT:
            (one, x), (other, y) = self._scaled(a), self._scaled(b)
            self._sums[slot] = {(min(one, other), max(one, other)): x * y}
        else:
            self._place[slot] = self._row(int(code), [(self._written(a), ONE, c)])

    def _terms(self, slot: int) -> Terms:
        """A slot as a sum, of its own terms if nothing else takes it or they are few."""
        terms = self._sums.get(slot)
        if terms is not None and slot not in self._place:
            is_multiple = len(terms) == 1 and ONE in next(iter(terms))
            if self._uses[slot] == 1 or is_multiple:
                return terms
        return {(ONE, self._written(slot)): 1.0}

    def _scaled(self, slot: int) -> tuple[int, float]:
        """A slot as a multiple of a written one."""
        terms = self._sums.get(slot, {})
        if len(terms) == 1:
            ((one, other), factor), *_ = terms.items()
            if one == ONE:
                return other, factor
        return self._written(slot), 1.0

    def _written(self, slot: int) -> int:
        """The place of a slot, whose row is written if it is not."""
        if slot not in self._place:
            terms = [(a, b, factor) for (a, b), factor in self._sums[slot].items()]
            self._place[slot] = self._row(SUM, terms)
        return self._place[slot]

    def _row(self, code: int, terms: list[tuple[int, int, float]]) -> int:
        self.rows.append((code, terms))
        return self.inputs + len(self.rows) - 1


def _added(a: Terms, b: Terms) -> Terms:
    found = dict(a)
    for pair, factor in b.items():
        found[pair] = found.get(pair, 0.0) + factor
    return {pair: factor for pair, factor in found.items() if factor}


def _uses(recording: Recording, outputs: Sequence[int]) -> list[int]:
    """How often every slot is taken by those that outputs depend on."""
    uses = [0] * (recording.count + len(recording.rows))
    for slot in outputs:
        uses[slot] += 1
    for slot in range(len(uses) - 1, recording.count - 1, -1):
        code, a, b, _ = recording.rows[slot - recording.count]
        if uses[slot]:
            uses[a] += 1
            uses[b] += code in COMMUTATIVE
    return uses
