r"""Laws of materials as programs: sums of products, in the order in which loops compute them.

Operations of a recorded law (`surrogate.mechanics.solids.deformation`) that only add and multiply
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

from surrogate.mechanics.energy.recording import Operation, Recording
from surrogate.mechanics.energy.tape import ONE, Tape

Numbers = NDArray[np.int64]
Doubles = NDArray[np.float64]
SUM, POWER, EXP, LN, STEP = (
    int(code)
    for code in (Operation.SUM, Operation.POWER, Operation.EXP, Operation.LN, Operation.STEP)
)
RecordedLaw = tuple[Recording, dict[str, Any]]  # and its outputs


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
            As `surrogate.mechanics.solids.deformation` records them.
        beside : int
            Number of the last inputs of all, θ and p: 0 or 2.
        wanted : sequence of str
        """
        inputs = 1 + max(recording.count for recording, _ in laws)
        written = []
        for recording, of in laws:
            given = [*range(1, 1 + recording.count - beside), *range(inputs - beside, inputs)]
            outputs = [each for name in wanted for each in recording.numbers(of[name])]
            written.append(Tape(recording, outputs, given, inputs))
        every = [_kept(tape) for tape in written]
        counts = [len(each.rows) for each in written]
        rows = [row for each in written for row in each.rows]
        terms = [term for _, of_row in rows for term in of_row]
        most = max(map(len, every))
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
            np.array([[slot for slot, _ in each.outputs] for each in written], np.int64),
            np.array([np.pad(each, (0, most - len(each))) for each in every], np.int64),
        )


def _kept(tape: Tape) -> Numbers:
    """Slots whose lower orders the higher ones depend on, the inputs first."""
    operands = {
        slot
        for place, (code, terms) in enumerate(tape.rows, start=tape.first)
        for a, b, _ in terms
        for slot in ([a, b] if ONE not in (a, b) else [])
        + ([a, place] if code not in (SUM, STEP) else [])
    }
    return np.array(
        [*range(1, tape.first), *sorted(each for each in operands if each >= tape.first)]
    )
