r"""A list of operations in which those that add and multiply are merged: a *tape*.

What runs it, with numbers, tensors or power series, in compiled loops or not, is the same for every
material.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from surrogate.mechanics.energy.recording import (
    FUNCTIONS,
    Operation,
    Recorded,
    Recording,
    Value,
    is_zero,
)

Terms: TypeAlias = list[tuple[int, int, float]]  # of a sum of products: two slots and a factor
ONE = 0  # slot of the number 1 in a tape


class Tape:
    r"""Operations that some outputs depend on, in which those that add and multiply are merged.

    A result is :math:`y = \sum_t f_t a_t b_t`, with numbers f and slots a and b, or a function of
    one slot. Slot 0 is the number 1, the inputs follow.

    Parameters
    ----------
    recording : Recording
    outputs : sequence of Value
        Recorded numbers; others are the same whatever the inputs are.
    inputs : sequence of int, optional
        Slots of the inputs; 1, 2, … by default.
    first : int, optional
        Slot of the first result; the one after the inputs by default.

    Attributes
    ----------
    rows : list of (Operation, Terms)
        `SUM`, or a function of the left slot of its only term, with the factor as its constant.
    outputs : list of (int, float)
        Slot of every output; of one that is always the same, −1, and the number.
    """

    def __init__(
        self,
        recording: Recording,
        outputs: Sequence[Value],
        inputs: Sequence[int] | None = None,
        first: int | None = None,
    ) -> None:
        given = range(1, 1 + recording.count) if inputs is None else inputs
        self.first, self.rows = first or 1 + len(given), list[tuple[Operation, Terms]]()
        found = [each.slot for each in outputs if isinstance(each, Recorded)]
        self._uses = recording.uses(found)
        self._place = dict(enumerate(given))  # of recorded slots
        self._sums: dict[int, dict[tuple[int, int], float]] = {}  # of those that are sums
        for slot, (code, a, b, c) in enumerate(recording.rows, start=recording.count):
            if self._uses[slot]:
                self._sum(slot, code, a, b, c)
        self.outputs = [
            (self._written(each.slot), 0.0) if isinstance(each, Recorded) else (-1, float(each))
            for each in outputs
        ]

    def __call__(self, inputs: Sequence[Value]) -> list[Value]:
        """Run on numbers, arrays, tensors, series or recorded numbers in the slots from 1 on."""
        slots = [1.0, *inputs]
        for code, terms in self.rows:
            if code == Operation.SUM:
                slots.append(sum_of_products([(slots[a], slots[b], c) for a, b, c in terms]))
            else:
                ((a, _, c),) = terms
                slots.append(FUNCTIONS[code](slots[a], c))
        return [number if slot < 0 else slots[slot] for slot, number in self.outputs]

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
            self._place[slot] = self._row(code, [(self._written(a), ONE, c)])

    def _terms(self, slot: int) -> dict[tuple[int, int], float]:
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
            self._place[slot] = self._row(Operation.SUM, terms)
        return self._place[slot]

    def _row(self, code: Operation, terms: Terms) -> int:
        self.rows.append((code, terms))
        return self.first + len(self.rows) - 1


def sum_of_products(terms: Sequence[tuple[Value, Value, float]]) -> Value:
    """Σ f a b of pairs and factors; of series, they compute it."""
    for a, b, _ in terms:
        for each in (a, b):
            if hasattr(each, "sum_of_products"):
                return each.sum_of_products(terms)
    total: Value = 0.0
    for a, b, c in terms:
        if isinstance(a, float):
            a, b, c = b, 1.0, c * a
        part = a if isinstance(b, float) and b == 1 else a * b
        part = part if c == 1 else c * part
        total = part if is_zero(total) else total + part
    return total


def _added(
    a: dict[tuple[int, int], float], b: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    found = dict(a)
    for pair, factor in b.items():
        found[pair] = found.get(pair, 0.0) + factor
    return {pair: factor for pair, factor in found.items() if factor}


def tape_of(recording: Recording, outputs: Sequence[Value]) -> Tape:
    """The tape of recorded numbers or constants, with products for whole powers."""
    other = Recording(recording.count)
    return Tape(other, recording.replayed(list(other.inputs), outputs))
