"""NumPy's computations as data: numbers of object arrays that write down what is done with them.

What `surrogate.mechanics` computes at a point becomes a list of scalar operations, which compiled
loops and the page run with numbers, their derivatives or power series
(`surrogate.mechanics.energy.tape`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.energy.tape import Operation, Tape

Value: TypeAlias = Any  # a `Recorded` number, or a constant
COMMUTATIVE = (Operation.SUM, Operation.PRODUCT)


class Recording:
    """Operations on slots, first the inputs; equal ones are written once.

    Parameters
    ----------
    inputs : int
        Number of inputs.
    """

    def __init__(self, inputs: int) -> None:
        self.count = inputs
        self.inputs = np.array([Recorded(self, slot) for slot in range(inputs)], dtype=object)
        self.rows: list[tuple[Operation, int, int, float]] = []
        self._known: dict[tuple[Operation, int, int, float], Recorded] = {}

    def row(self, code: Operation, left: int, right: int = 0, constant: float = 0.0) -> Recorded:
        """Write an operation."""
        if code in COMMUTATIVE:
            left, right = min(left, right), max(left, right)
        row = (code, left, right, constant)
        if row not in self._known:
            self._known[row] = Recorded(self, self.count + len(self.rows))
            self.rows.append(row)
        return self._known[row]

    def run(self, tape: Tape, inputs: Sequence[Value]) -> list[Value]:
        """Write the operations of a tape; outputs that are fixed are constants."""
        slots = [int(np.asarray(value).item().slot) for value in inputs]
        for code, left, right, constant in tape.rows:
            a, b = slots[left], slots[right] if code in COMMUTATIVE else 0
            if code == Operation.POSITIVE:
                code, b = Operation.PRODUCT, self.row(Operation.STEP, a).slot
            slots.append(self.row(code, a, b, constant).slot)
        return [c if slot < 0 else Recorded(self, slots[slot]) for slot, c in tape.places]

    def data(self, stages: Sequence[int], outputs: dict[str, Any]) -> dict[str, Any]:
        """The operations that outputs depend on, as plain data.

        Parameters
        ----------
        stages : sequence of int
            Of every input: operations follow in the order of the last stage of what they take.
        outputs : dict
            Numbers or arrays of numbers; those of ``energy`` stand at the end.

        Returns
        -------
        dict
            Number of ``inputs``; ``codes``, ``left``, ``right`` and ``constants`` of the
            operations; ``ends``, their number up to the end of every stage; slots of the outputs.
        """
        slots = {name: self.slots_of(of) for name, of in outputs.items()}
        last = max(stages) + 1
        of_row = [*stages]
        for code, left, right, _ in self.rows:
            of_row.append(max(of_row[left], of_row[right] if code in COMMUTATIVE else 0))
        needed = dict.fromkeys(range(self.count), 0)
        for name, of_output in sorted(slots.items(), key=lambda item: item[0] != "energy"):
            waiting = of_output.ravel().tolist()
            while waiting:
                slot = waiting.pop()
                stage = last if name == "energy" else of_row[slot]
                if slot < self.count or needed.get(slot, last + 1) <= stage:
                    continue
                needed[slot] = stage
                code, left, right, _ = self.rows[slot - self.count]
                waiting += [left, right] if code in COMMUTATIVE else [left]
        order = sorted(needed, key=lambda slot: (slot >= self.count, needed[slot], slot))
        place = {slot: number for number, slot in enumerate(order)}
        rows = [self.rows[slot - self.count] for slot in order[self.count :]]
        return {
            "inputs": self.count,
            "codes": [int(row[0]) for row in rows],
            "left": [place[row[1]] for row in rows],
            "right": [place[row[2]] if row[0] in COMMUTATIVE else 0 for row in rows],
            "constants": [row[3] for row in rows],
            "ends": [
                sum(needed[slot] <= stage for slot in order[self.count :])
                for stage in range(last + 1)
            ],
        } | {name: np.vectorize(place.get, otypes=[int])(of).tolist() for name, of in slots.items()}

    def slots_of(self, values: Any) -> NDArray[np.int64]:
        """Slots of recorded numbers, or of an array of some; constants become slots."""
        return np.asarray(np.vectorize(self._slot, otypes=[int])(values))

    def _slot(self, value: Value) -> int:
        if isinstance(value, Recorded):
            return value.slot
        nothing = self.row(Operation.SCALE, 0).slot
        return self.row(Operation.SHIFT, nothing, constant=float(value)).slot


class Recorded:
    """A number that an operation of a recording gives."""

    def __init__(self, recording: Recording, slot: int) -> None:
        self.recording, self.slot = recording, slot

    def __add__(self, other: Value) -> Value:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if isinstance(other, Recorded):
            return self.recording.row(Operation.SUM, self.slot, other.slot)
        if other == 0:
            return self
        return self.recording.row(Operation.SHIFT, self.slot, constant=float(other))

    def __mul__(self, other: Value) -> Value:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if isinstance(other, Recorded):
            return self.recording.row(Operation.PRODUCT, self.slot, other.slot)
        if other in (0, 1):
            return self if other == 1 else 0.0
        return self.recording.row(Operation.SCALE, self.slot, constant=float(other))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Value:
        return self * -1.0

    def __sub__(self, other: Value) -> Value:
        return self + -other

    def __gt__(self, other: float) -> bool:
        return True  # as of a state that is possible

    __lt__ = __gt__
