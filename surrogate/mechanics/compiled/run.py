r"""Programs of laws, run on rows of points with truncated power series, in compiled loops.

Order 0 of every slot is its value, order 1 beside it a derivative; series have more orders. The
coefficients of a product, and of the functions (`surrogate.mechanics.energy.recording`),
are sums of products of those before, so that one loop over a row is the only one that matters.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from shared_schema.materials import ZERO
from surrogate.mechanics.compiled.fields import Array, inner
from surrogate.mechanics.compiled.program import EXP, LN, POWER, STEP, SUM, Numbers, Programs
from surrogate.mechanics.energy.tape import ONE

Flags = NDArray[np.bool_]


@inner
def begin(values: Array, known: Flags) -> None:
    """Let the slot 1 be that number, and all others be zero."""
    known[:], values[0, ONE] = False, 1
    known[0, ONE] = True


@inner
def run(programs: Programs, law: int, k: int, values: Array, known: Flags) -> None:
    """Compute the coefficients of order k of all results, of those at the inputs.

    Parameters
    ----------
    programs : Programs
    law : int
        Its number.
    k : int
    values : array, (n_orders, n_slots, n_points)
        Coefficients.
    known : array of bool, (n_orders, n_slots)
        Whether coefficients are not zero; values that are zero are neither read nor written.
    """
    most = (k + 1) * programs.most
    pairs, factors = np.empty((most, 4), np.int64), np.empty(most, values.dtype)
    for place in range(programs.first[law], programs.first[law + 1]):
        y, code = programs.inputs + place - programs.first[law], programs.codes[place]
        start, stop = programs.starts[place], programs.starts[place + 1]
        a, c = programs.left[start], programs.factors[start]
        known[k, y], count = False, 0
        if code != SUM and k == 0:
            function_of(code, values[0, a], c, values[0, y])
            known[0, y] = True
            continue
        for t in range(start, stop if code != STEP else start):
            c, b = programs.factors[t], programs.right[t]
            if code in (POWER, EXP):
                b = y
            elif code == LN:
                a, b = y, programs.left[t]
            else:
                a = programs.left[t]
            for i in range(k + 1):
                factor = c
                if code == POWER:
                    factor = (c * i - k + i) / k
                elif code == EXP:
                    factor = i / k
                elif code == LN:
                    factor = -i / k
                elif a == b and 2 * i != k:
                    factor = 2 * c if 2 * i < k else 0.0
                if factor != 0 and known[i, a] and known[k - i, b]:
                    pairs[count], factors[count] = (i, a, k - i, b), factor
                    count += 1
            if code == LN and known[k, b]:
                pairs[count], factors[count] = (k, b, 0, ONE), 1.0
                count += 1
        if count > 0:
            known[k, y] = True
            add_products(count, pairs, factors, values, values[k, y])
            if code in (POWER, LN):
                out, by = values[k, y], values[0, programs.left[start]]
                for q in range(len(out)):
                    out[q] /= by[q]


@inner
def add_products(count: int, pairs: Numbers, factors: Array, values: Array, out: Array) -> None:
    """Write the sum of so many products, in twos or fours; beside an odd one stands 0 · 1 · 1."""
    if count % 2:
        factors[count], pairs[count] = 0, (0, ONE, 0, ONE)
    for n in range(0, count, 4):
        a0, b0 = values[pairs[n, 0], pairs[n, 1]], values[pairs[n, 2], pairs[n, 3]]
        a1, b1 = values[pairs[n + 1, 0], pairs[n + 1, 1]], values[pairs[n + 1, 2], pairs[n + 1, 3]]
        f0, f1 = factors[n], factors[n + 1]
        if count > n + 2:
            a2, b2 = (
                values[pairs[n + 2, 0], pairs[n + 2, 1]],
                values[pairs[n + 2, 2], pairs[n + 2, 3]],
            )
            a3, b3 = (
                values[pairs[n + 3, 0], pairs[n + 3, 1]],
                values[pairs[n + 3, 2], pairs[n + 3, 3]],
            )
            f2, f3 = factors[n + 2], factors[n + 3]
            if n:
                for q in range(len(out)):
                    out[q] += (
                        f0 * a0[q] * b0[q]
                        + f1 * a1[q] * b1[q]
                        + f2 * a2[q] * b2[q]
                        + f3 * a3[q] * b3[q]
                    )
            else:
                for q in range(len(out)):
                    out[q] = (
                        f0 * a0[q] * b0[q]
                        + f1 * a1[q] * b1[q]
                        + f2 * a2[q] * b2[q]
                        + f3 * a3[q] * b3[q]
                    )
        elif n:
            for q in range(len(out)):
                out[q] += f0 * a0[q] * b0[q] + f1 * a1[q] * b1[q]
        else:
            for q in range(len(out)):
                out[q] = f0 * a0[q] * b0[q] + f1 * a1[q] * b1[q]


@inner
def function_of(code: int, a: Array, c: float, out: Array) -> None:
    """Write a function of a row."""
    if code == POWER and c == -1:
        for q in range(len(out)):
            out[q] = 1 / a[q]
    elif code == POWER:
        for q in range(len(out)):
            out[q] = a[q] ** c
    elif code == EXP:
        for q in range(len(out)):
            out[q] = math.exp(a[q])
    elif code == LN:
        for q in range(len(out)):
            out[q] = math.log(a[q])
    else:
        for q in range(len(out)):
            out[q] = 1 if a[q] > -ZERO else 0
