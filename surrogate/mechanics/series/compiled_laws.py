r"""Laws of materials in loops that Numba compiles: power series of their tapes.

Tapes and their values are those of `surrogate.mechanics.compiled.tapes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials import ZERO
from surrogate.mechanics.compiled.fields import Array, inner
from surrogate.mechanics.compiled.tapes import (
    EXP,
    LN,
    POWER,
    PRODUCT,
    SCALE,
    SHIFT,
    STEP,
    SUM,
    Doubles,
    Tapes,
)
from surrogate.mechanics.energy.law import DILATION, FIBRES, FIRST, SECOND, VOLUME, Law
from surrogate.mechanics.series.measured_series import slopes_at_rest, used_measures

INPUTS = FIBRES  # measures of a law without fibres: I₁, I₂, J, θ
I1, I2, J, THETA = FIRST, SECOND, VOLUME, DILATION


class Laws(NamedTuple):
    """What is known of the materials of a body.

    Attributes
    ----------
    stress, energy : Tapes
        Of `surrogate.mechanics.energy.law.Law`.
    rest : array, (n_laws, n_slots)
        Values of all slots of the stress tape, undeformed.
    slopes : array, (n_laws, n_slots)
        Their derivatives by tr H.
    first_varies, second_is : array of bool, (n_laws,)
        Whether I₁ is looked at; whether the energy depends on I₂.
    """

    stress: Tapes
    energy: Tapes
    rest: Doubles
    slopes: Doubles
    first_varies: NDArray[np.bool_]
    second_is: NDArray[np.bool_]

    @classmethod
    def of(cls, laws: Sequence[Law]) -> Laws:
        """Arrange some laws without fibres."""
        stress = Tapes.of([law.stress for law in laws])
        slots = INPUTS + stress.codes.shape[1]
        rest, slopes = np.zeros((2, len(laws), slots))
        for number, law in enumerate(laws):
            values = law.stress.slots(law.at_rest)
            rest[number, : len(values)] = values
            of_slots = np.array(slopes_at_rest(law))
            slopes[number, : len(values)] = of_slots[:, :3] @ (2.0, 4.0, 1.0)
        used = [used_measures(law) for law in laws]
        return cls(
            stress,
            Tapes.of([law.energy for law in laws]),
            rest,
            slopes,
            np.array([FIRST in some for some in used]),
            np.array([SECOND in some for some in used]),
        )


@inner
def next_coefficients(k: int, number: int, laws: Laws, slots: Array) -> None:
    """Run the stress tape of a law for the coefficients of order k.

    Parameters
    ----------
    k : int
        2 at least.
    number : int
        Of the law.
    laws : Laws
    slots : array, (n_orders, n_slots, n_points)
        Coefficients from order 1 on; those of order k at the inputs are given.
    """
    tapes, new = laws.stress, k - 1
    points = slots.shape[2]
    real = slots.dtype.type
    for op in range(tapes.counts[number]):
        place, code = INPUTS + op, tapes.codes[number, op]
        left, right = tapes.left[number, op], tapes.right[number, op]
        constant = tapes.constants[number, op]
        out, a = slots[new, place], slots[new, left]
        first, value = laws.rest[number, left], laws.rest[number, place]
        if code == SUM:
            b = slots[new, right]
            for q in range(points):
                out[q] = a[q] + b[q]
        elif code == SHIFT:
            for q in range(points):
                out[q] = a[q]
        elif code == PRODUCT:
            b = slots[new, right]
            x, y = real(laws.rest[number, right]), real(first)
            for q in range(points):
                out[q] = x * a[q] + y * b[q]
            for j in range(new):
                one, other = slots[j, left], slots[new - 1 - j, right]
                for q in range(points):
                    out[q] += one[q] * other[q]
        elif code == STEP:
            out[:] = 0
        else:
            factor = real(1.0)
            if code == SCALE:
                factor = real(constant)
            elif code == POWER:
                factor = real(constant * value / first)
            elif code == EXP:
                factor = real(value)
            elif code == LN:
                factor = real(1 / first)
            else:
                factor = real(1.0 if first > -ZERO else 0.0)
            for q in range(points):
                out[q] = factor * a[q]
            if code in (POWER, EXP, LN):
                for j in range(1, k):
                    if code == POWER:
                        factor = real((constant * j - k + j) / (k * first))
                    elif code == EXP:
                        factor = real(j / k)
                    else:
                        factor = real(-j / (k * first))
                    one = slots[k - j - 1, left] if code == LN else slots[j - 1, left]
                    other = slots[j - 1, place] if code == LN else slots[k - j - 1, place]
                    for q in range(points):
                        out[q] += factor * one[q] * other[q]
