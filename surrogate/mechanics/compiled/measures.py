r"""Stress and moduli at rows of points, compiled: `surrogate.mechanics.solids.deformation`.

Tensors of a row are (d, d, n), fibres (families, d, n), scalars (n,). Slots are those of a tape
(`surrogate.mechanics.compiled.tapes`), whose inputs are the measures.
"""

from __future__ import annotations

import numpy as np

from surrogate.mechanics.compiled.fields import (
    Array,
    add_contraction,
    add_cross,
    add_multiple,
    inner,
)
from surrogate.mechanics.compiled.tapes import Doubles, Tapes
from surrogate.mechanics.energy.law import DILATION, FIBRES, FIRST, SECOND, VOLUME

I1, I2, J, THETA, I4 = FIRST, SECOND, VOLUME, DILATION, FIBRES


@inner
def cofactors(f: Array, out: Array) -> None:
    """Write cof F: (d, d, n) → same."""
    out[:] = 0
    add_cross(0.5 if len(f) == 3 else 1.0, f, f, out)


@inner
def measure(f: Array, cof: Array, fibres: Array, count: int, slots: Doubles) -> None:
    """Write the measures of a law with so many, without J and θ."""
    slots[I1] = 3.0 - len(f)
    add_contraction(1.0, f, f, slots[I1])
    if len(f) == 3:
        slots[I2] = 0
        add_contraction(1.0, cof, cof, slots[I2])
    for a in range(I4, count):
        of = cof if (a - I4) % 2 else f
        slots[a] = 0
        for i in range(len(f)):
            _add_square(of[i], fibres[(a - I4) // 2], slots[a])


@inner
def _add_square(row: Array, a: Array, out: Doubles) -> None:
    """Add (row · a)²: (d, n) twice → (n,)."""
    for q in range(len(out)):
        total = row[0, q] * a[0, q] + row[1, q] * a[1, q]
        if len(row) == 3:
            total += row[2, q] * a[2, q]
        out[q] += total * total


@inner
def dyad(of: Array, a: Array, out: Array) -> None:
    """Write A a ⊗ a: (d, d, n), (d, n) → (d, d, n)."""
    for i in range(len(of)):
        for j in range(len(of)):
            row = out[i, j]
            row[:] = 0
            for k in range(len(of)):
                for q in range(len(row)):
                    row[q] += of[i, k, q] * a[k, q] * a[j, q]


@inner
def add_weighted(factor: float, by: Doubles, a: Array, out: Array) -> None:
    """Add x b A: (n,), (d, d, n) → (d, d, n)."""
    for i in range(len(a)):
        for j in range(len(a)):
            row, total = a[i, j], out[i, j]
            for q in range(len(by)):
                total[q] += factor * by[q] * row[q]


@inner
def add_derivative(
    number: int, by: Doubles, f: Array, cof: Array, fibres: Array, parts: Array, out: Array
) -> None:
    """Add a multiple of ∂m/∂F of a measure, none of θ; `parts`, two tensors, are overwritten."""
    if number == I1:
        add_weighted(2.0, by, f, out)
    elif number == J:
        add_weighted(1.0, by, cof, out)
    elif number != THETA:
        one, other = parts[0], parts[1]
        is_area = (number - I4) % 2 == 1
        if number >= I4:
            dyad(cof if is_area else f, fibres[(number - I4) // 2], one)
        if number == I2 or is_area:
            other[:] = 0
            if number == I2:
                add_cross(1.0, cof, f, other)
            else:
                add_cross(1.0, f, one, other)
            one = other
        add_weighted(2.0, by, one, out)


@inner
def add_turned(
    number: int, f: Array, cof: Array, fibres: Array, h: Array, parts: Array, out: Array
) -> None:
    """Add ∂²m/∂F² : H of a measure; `parts`, two tensors, are overwritten."""
    one, other = parts[0], parts[1]
    if number == I1:
        add_multiple(2.0, h.ravel(), out.ravel())
    elif number == J:
        add_cross(1.0, f, h, out)
    elif number == I2:
        one[:] = 0
        add_cross(2.0, f, h, one)
        add_cross(1.0, one, f, out)
        add_cross(2.0, cof, h, out)
    elif number >= I4:
        a = fibres[(number - I4) // 2]
        if (number - I4) % 2 == 1:
            one[:] = 0
            add_cross(2.0, f, h, one)
            dyad(one, a, other)
            add_cross(1.0, f, other, out)
            if len(f) == 3:  # in the plane cofactors are linear
                dyad(cof, a, other)
                add_cross(2.0, h, other, out)
        else:
            dyad(h, a, one)
            add_multiple(2.0, one.ravel(), out.ravel())


@inner
def weight(tapes: Tapes, number: int, output: int, slots: Doubles, out: Doubles) -> bool:
    """Write an output of a law's tape, (n,); False if it is always zero."""
    place, fixed = tapes.outputs[number, output], tapes.fixed[number, output]
    if place < 0:
        out[:] = fixed
        return bool(fixed != 0)
    values = slots[place]
    for q in range(len(out)):
        out[q] = values[q]
    return True


@inner
def pair(count: int, a: int, b: int) -> int:
    """Number of the output of an energy that is its derivative by two of so many measures."""
    low, high = min(a, b), max(a, b)
    return 1 + count + low * count - low * (low - 1) // 2 + high - low


@inner
def moduli(
    tapes: Tapes,
    number: int,
    slots: Doubles,
    pressure: Array,
    f: Array,
    cof: Array,
    fibres: Array,
    parts: Array,
    out: Array,
) -> None:
    r"""Write ∂P/∂F at fixed θ and p: → (d, d, d, d, n).

    .. math::
        \frac{∂P}{∂F} : H = \sum_a \left(\sum_b ψ_{ab} \frac{∂m_b}{∂F} : H\right)
        \frac{∂m_a}{∂F} + \sum_a ψ_a \frac{∂^2 m_a}{∂F^2} : H.

    Parameters
    ----------
    tapes, number, slots
        Of an energy, and the values there.
    pressure : array, (n,) or (0,)
    f, cof : array, (d, d, n)
    fibres : array, (families, d, n)
    parts : array, (4, d, d, n)
        Overwritten.
    """
    by, h, slope = np.empty(f.shape[2]), parts[2], parts[3]
    count, d = tapes.inputs[number], len(f)
    out[:], h[:] = 0, 0
    for a in range(count):
        used = weight(tapes, number, 1 + a, slots, by)
        if a == J and len(pressure):
            used = True
            for q in range(len(by)):
                by[q] += pressure[q]
        if a == THETA or not used:
            continue
        for k in range(d):
            for m in range(d):  # by symmetry, ∂P/∂F : H is a row as well
                if a == I1:
                    add_multiple(2.0, by, out[k, m, k, m])
                    continue
                for q in range(len(by)):
                    h[k, m, q] = by[q]
                add_turned(a, f, cof, fibres, h, parts, out[k, m])
                h[k, m] = 0
    for a in range(count):
        h[:], found = 0, False
        for b in range(count):
            if a != THETA and b != THETA and weight(tapes, number, pair(count, a, b), slots, by):
                add_derivative(b, by, f, cof, fibres, parts, h)
                found = True
        if found:
            by[:], slope[:] = 1, 0
            add_derivative(a, by, f, cof, fibres, parts, slope)
            for i in range(d):
                for j in range(d):
                    row = slope[i, j]
                    for k in range(d):
                        for m in range(d):
                            other, total = h[k, m], out[i, j, k, m]
                            for q in range(len(row)):
                                total[q] += row[q] * other[q]
