r"""Computations as data: numbers that write down what is done with them, and its derivatives.

What `surrogate.mechanics` computes at a point is a list of scalar operations on *slots*, first the
inputs, then the result of every operation. Compiled loops and the page run it with numbers, their
derivatives or power series, whatever the material is, a user's own among them:

==========  ====================  =================================
operation   value y of a and b    derivatives by a and b
==========  ====================  =================================
SUM         a + b                 1, 1
SCALE       c a                   c
SHIFT       a + c                 1
PRODUCT     a b                   b, a
POWER       :math:`a^c`           :math:`c \, a^{c - 1}`
EXP         exp a                 y
LN          ln a                  1 / a
STEP        1 if a ≥ 0, or 0      0
==========  ====================  =================================

A number above −`shared_schema.materials.ZERO` counts as no less than 0, as in the energy itself.
The coefficients of the power series of y are, for k ≥ 1,

.. math::
    y_k = \frac{∂y}{∂a} a_k + \frac{∂y}{∂b} b_k + \sum_{j=1}^{k-1} w_{jk} \, a_j z_{k-j}

with the derivatives at the coefficients of order 0, and z = y, or z = b in a product. The weight
:math:`w_{jk}` is 1 in a product, (c j − k + j) / (k a₀) in a power, j / k in EXP and
(j − k) / (k a₀) in LN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials import ZERO

Value: TypeAlias = Any  # a `Recorded` number or a constant; where a tape is run, whatever it is of
FACTORS = 8  # most factors of a whole power that are multiplied one after the other
WHOLE = 1e-12  # largest distance of an exponent from a whole number that is a rounding error


class Operation(IntEnum):
    """Operations on slots."""

    SUM = 0
    SCALE = 1
    SHIFT = 2
    PRODUCT = 3
    POWER = 4
    EXP = 5
    LN = 6
    STEP = 8


Row: TypeAlias = tuple[Operation, int, int, float]  # and its slots a and b, and number c
COMMUTATIVE = (Operation.SUM, Operation.PRODUCT)


def exp(a: Value) -> Value:
    """Exponential function of a number, an array, or what has it as a method."""
    return a.exp() if hasattr(a, "exp") else np.exp(a)


def log(a: Value) -> Value:
    """Natural logarithm, likewise."""
    return a.log() if hasattr(a, "log") else np.log(a)


def step(a: Value) -> Value:
    """1 where a is positive or zero, else 0, likewise."""
    return a.step() if hasattr(a, "step") else 1.0 * (a > -ZERO)


FUNCTIONS: dict[Operation, Callable[[Value, float], Value]] = {
    Operation.POWER: lambda a, c: 1 / a if c == -1 else a**c,
    Operation.EXP: lambda a, c: exp(a),
    Operation.LN: lambda a, c: log(a),
    Operation.STEP: lambda a, c: step(a),
}
SLOPES: dict[Operation, Callable[[Value, Value, Value, float], tuple[Value, Value]]] = {
    Operation.SUM: lambda a, b, y, c: (1.0, 1.0),
    Operation.SCALE: lambda a, b, y, c: (c, 0.0),
    Operation.SHIFT: lambda a, b, y, c: (1.0, 0.0),
    Operation.PRODUCT: lambda a, b, y, c: (b, a),
    Operation.POWER: lambda a, b, y, c: (c * a ** (c - 1), 0.0),
    Operation.EXP: lambda a, b, y, c: (y, 0.0),
    Operation.LN: lambda a, b, y, c: (1 / a, 0.0),
    Operation.STEP: lambda a, b, y, c: (0.0, 0.0),
}


class Recording:
    """Operations on slots, first the inputs; equal ones are written once.

    It is what an energy takes for its functions (`shared_schema.materials.Functions`).

    Parameters
    ----------
    inputs : int
        Number of inputs.
    """

    def __init__(self, inputs: int) -> None:
        self.count = inputs
        self.inputs = np.array([Recorded(self, slot) for slot in range(inputs)], dtype=object)
        self.rows: list[Row] = []
        self._known: dict[Row, Recorded] = {}

    def row(self, code: Operation, left: int, right: int = 0, constant: float = 0.0) -> Recorded:
        """Write an operation."""
        if code in COMMUTATIVE:
            left, right = min(left, right), max(left, right)
        row = (code, left, right, constant)
        if row not in self._known:
            self._known[row] = Recorded(self, self.count + len(self.rows))
            self.rows.append(row)
        return self._known[row]

    def ln(self, x: Value, /) -> Value:
        """Natural logarithm."""
        return log(x)

    def exp(self, x: Value, /) -> Value:
        """Exponential function."""
        return exp(x)

    def positive(self, x: Value, /) -> Value:
        """Return max(x, 0)."""
        return x * step(x)

    def gradient(self, of: Value) -> list[Value]:
        """Derivatives of a number by the inputs, recorded as well, from the last operation back."""
        found: list[Value] = [0.0] * (self.count + len(self.rows))
        if isinstance(of, Recorded):
            found[of.slot] = 1.0
        for slot in range(len(found) - 1, self.count - 1, -1):
            if not is_zero(found[slot]):
                code, left, right, c = self.rows[slot - self.count]
                a, b, y = (Recorded(self, place) for place in (left, right, slot))
                for place, slope in zip((left, right), SLOPES[code](a, b, y, c), strict=True):
                    if not is_zero(slope):
                        found[place] = found[place] + found[slot] * slope
        return found[: self.count]

    def replayed(self, inputs: Sequence[Value], outputs: Sequence[Value]) -> list[Value]:
        """Record outputs once more, of other recorded inputs, with products for whole powers."""
        found = list(inputs)
        for code, a, b, c in self.rows:
            if code == Operation.POWER:
                found.append(_power(found[a], c))
            elif code in FUNCTIONS:
                found.append(FUNCTIONS[code](found[a], c))
            else:
                right = found[b].slot if code in COMMUTATIVE else 0
                found.append(found[a].recording.row(code, found[a].slot, right, c))
        return [found[each.slot] if isinstance(each, Recorded) else each for each in outputs]

    def uses(self, outputs: Sequence[int]) -> list[int]:
        """How often every slot is taken by those that outputs depend on, or is one."""
        uses = [0] * (self.count + len(self.rows))
        for slot in outputs:
            uses[slot] += 1
        for slot in range(len(uses) - 1, self.count - 1, -1):
            code, a, b, _ = self.rows[slot - self.count]
            if uses[slot]:
                uses[a] += 1
                uses[b] += code in COMMUTATIVE
        return uses

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
        ends = {name: of.ravel().tolist() for name, of in slots.items()}
        early = self.uses([slot for name in ends if name != "energy" for slot in ends[name]])
        uses = self.uses([slot for of in ends.values() for slot in of])
        needed = [slot for slot in range(self.count, len(uses)) if uses[slot]]
        stage_of = {slot: of_row[slot] if early[slot] else last for slot in needed}
        order = [*range(self.count), *sorted(needed, key=lambda slot: (stage_of[slot], slot))]
        place = {slot: number for number, slot in enumerate(order)}
        rows = [self.rows[slot - self.count] for slot in order[self.count :]]
        return {
            "inputs": self.count,
            "codes": [int(row[0]) for row in rows],
            "left": [place[row[1]] for row in rows],
            "right": [place[row[2]] if row[0] in COMMUTATIVE else 0 for row in rows],
            "constants": [row[3] for row in rows],
            "ends": [
                sum(of_slot <= stage for of_slot in stage_of.values()) for stage in range(last + 1)
            ],
        } | {name: np.vectorize(place.get, otypes=[int])(of).tolist() for name, of in slots.items()}

    def slots_of(self, values: Any) -> NDArray[np.int64]:
        """Slots of recorded numbers, or of an array of some; constants become slots."""
        return np.asarray(np.vectorize(self._slot, otypes=[int])(values))

    def numbers(self, values: Any) -> list[Recorded]:
        """Recorded numbers, or those of an array of some; constants are recorded too."""
        return [Recorded(self, slot) for slot in self.slots_of(values).ravel().tolist()]

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

    def __pos__(self) -> Value:
        return self

    def __sub__(self, other: Value) -> Value:
        return self + -other

    def __rsub__(self, other: Value) -> Value:
        return -self + other

    def __truediv__(self, other: Value) -> Value:
        return self * (other**-1 if isinstance(other, Recorded) else 1 / other)

    def __rtruediv__(self, other: Value) -> Value:
        return other * self**-1

    def __pow__(self, exponent: float) -> Value:
        if exponent in (0, 1):
            return self if exponent == 1 else 1.0
        return self.recording.row(Operation.POWER, self.slot, constant=float(exponent))

    def exp(self) -> Recorded:
        """Exponential function."""
        return self.recording.row(Operation.EXP, self.slot)

    def log(self) -> Recorded:
        """Natural logarithm."""
        return self.recording.row(Operation.LN, self.slot)

    def step(self) -> Recorded:
        """1 if the number is not negative, else 0."""
        return self.recording.row(Operation.STEP, self.slot)

    def __gt__(self, other: float) -> bool:
        return True  # as of a state that is possible

    __lt__ = __gt__


def is_zero(value: Value) -> bool:
    """Whether a value is the number zero, whatever the inputs are."""
    return isinstance(value, float) and value == 0


def _power(a: Value, exponent: float) -> Value:
    """A power, as the product of a whole one and one between −1 and 0, which others share."""
    whole = math.ceil(exponent - WHOLE)
    part = round(exponent - whole, 14)  # derivatives share it
    found = a**part if abs(part) > WHOLE else 1.0
    factor, count = a if whole > 0 else a**-1, abs(whole)
    while count > FACTORS:  # square and multiply
        if count % 2:
            found = found * factor
        factor, count = factor * factor, count // 2
    for _ in range(count):
        found = found * factor
    return found
