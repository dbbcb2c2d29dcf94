r"""Tapes of the materials of a body, run on rows of points by loops that Numba compiles.

The tapes of all materials of a body are rows of one table, so that one compiled program is for any
of them (`surrogate.mechanics.energy.tape`). Values at the points of a block of cells are rows, in
which every operation is one loop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials import ZERO
from surrogate.mechanics.compiled.fields import inner
from surrogate.mechanics.energy.tape import Operation, Tape

Numbers = NDArray[np.int64]
Doubles = NDArray[np.float64]
SUM, SCALE, SHIFT, PRODUCT, POWER, EXP, LN, POSITIVE, STEP = (int(code) for code in Operation)


class Tapes(NamedTuple):
    """Tapes of all materials, filled up with operations that none has.

    Attributes
    ----------
    inputs, counts : array of int, (n_laws,)
        Numbers of inputs and of operations.
    codes, left, right : array of int, (n_laws, n)
    constants : array, (n_laws, n)
    outputs : array of int, (n_laws, m)
    fixed : array, (n_laws, m)
    slots : int
        Largest number of inputs and operations together.
    """

    inputs: Numbers
    counts: Numbers
    codes: Numbers
    left: Numbers
    right: Numbers
    constants: Doubles
    outputs: Numbers
    fixed: Doubles
    slots: int

    @classmethod
    def of(cls, tapes: Sequence[Tape]) -> Tapes:
        """Arrange some tapes."""
        most = max(len(tape.codes) for tape in tapes)
        most_outputs = max(len(tape.outputs) for tape in tapes)

        def rows(columns: Sequence[NDArray[Any]], length: int = most) -> NDArray[Any]:
            return np.array([np.pad(each, (0, length - len(each))) for each in columns])

        return cls(
            np.array([tape.inputs for tape in tapes]),
            np.array([len(tape.codes) for tape in tapes]),
            rows([tape.codes for tape in tapes]),
            rows([tape.left for tape in tapes]),
            rows([tape.right for tape in tapes]),
            rows([tape.constants for tape in tapes]),
            rows([tape.outputs for tape in tapes], most_outputs),
            rows([tape.fixed for tape in tapes], most_outputs),
            max(tape.inputs + len(tape.codes) for tape in tapes),
        )


@inner
def values_of(number: int, tapes: Tapes, slots: Doubles) -> None:
    """Run a tape of a law on the rows of its inputs: (n_slots, n_points)."""
    points, first = slots.shape[1], tapes.inputs[number]
    for op in range(tapes.counts[number]):
        code, constant = tapes.codes[number, op], tapes.constants[number, op]
        out, a = slots[first + op], slots[tapes.left[number, op]]
        if code == SUM:
            b = slots[tapes.right[number, op]]
            for q in range(points):
                out[q] = a[q] + b[q]
        elif code == SCALE:
            for q in range(points):
                out[q] = constant * a[q]
        elif code == SHIFT:
            for q in range(points):
                out[q] = a[q] + constant
        elif code == PRODUCT:
            b = slots[tapes.right[number, op]]
            for q in range(points):
                out[q] = a[q] * b[q]
        elif code == POWER:
            if constant == -1:
                for q in range(points):
                    out[q] = 1 / a[q]
            else:
                for q in range(points):
                    out[q] = a[q] ** constant
        elif code == EXP:
            for q in range(points):
                out[q] = math.exp(a[q])
        elif code == LN:
            for q in range(points):
                out[q] = math.log(a[q])
        elif code == POSITIVE:
            for q in range(points):
                out[q] = a[q] if a[q] > -ZERO else 0.0
        else:
            for q in range(points):
                out[q] = 1.0 if a[q] > -ZERO else 0.0
