r"""Power series of the stress, compiled, cell by cell.

The equations are those of `surrogate.mechanics.series.measured_series`.
`next_stress` is the recursion of one row of points, `add_term` that of all cells. They are for
elements without a dilation of their own, and materials without fibres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surrogate.mechanics.compiled.cells import (
    Cells,
    add_at_nodes,
    add_forces,
    at_corners,
    slopes_of,
)
from surrogate.mechanics.compiled.fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_trace,
    inner,
)
from surrogate.mechanics.series.compiled_laws import I1, I2, THETA, Laws, next_coefficients


class Terms(NamedTuple):
    """Terms k = 1, 2, … of the fields of N series, in rows k - 1, at rows of points.

    Attributes
    ----------
    h, c : array, (N, n_rows, n, d, d, n_points)
        Hₖ and Cₖ.
    x : array, (N, n_rows, n, d, d, n_points)
        Terms of cof F × F; of no points where no energy depends on I₂.
    slots : array, (N, n_rows, n, n_slots, n_points)
        Terms of the slots of the laws' tapes.
    """

    h: Array
    c: Array
    x: Array
    slots: Array

    def of(self, loads: slice) -> Terms:
        """Those of some loads."""
        return Terms(*(field[loads] for field in self))


def room_for_terms(loads: int, order: int, cells: Cells, laws: Laws) -> Terms:
    """Make room for the terms of some loads: by NumPy, which asks for large pages of memory."""
    blocks, points, _, d, row = cells.gradients.shape
    rows, kind = blocks * points, cells.gradients.dtype
    shape = loads, rows, order, d, d, row
    slots = np.empty((loads, rows, order, laws.rest.shape[1], row), kind)
    x = np.empty((*shape[:-1], row if laws.second_is.any() else 0), kind)
    return Terms(np.empty(shape, kind), np.empty(shape, kind), x, slots)


@inner
def next_stress(
    k: int, terms: Terms, load: int, row: int, number: int, laws: Laws, stress: Array
) -> None:
    r"""Complete the terms k - 1 from their H, and begin those of order k as if :math:`H_k = 0`.

    Parameters
    ----------
    k : int
        2 at least; all orders from 2 on, in turn.
    terms : Terms
    load, row, number : int
        Numbers of the series, of the row of points, and of its law.
    laws : Laws
    stress : array, (d, d, n_points)
        Output: :math:`P_k` without the part that is linear in :math:`H_k`.
    """
    h, c, slots = terms.h[load, row], terms.c[load, row], terms.slots[load, row]
    d, points = h.shape[1], h.shape[3]
    new, old, real = k - 1, k - 2, h.dtype.type
    tapes, second = laws.stress, laws.second_is[number]
    count = THETA + 1 + tapes.counts[number]
    if old == 0:
        c[0], slots[0] = 0, 0
    add_linear_cofactors(h[old], c[old])
    trace = np.zeros(points, h.dtype)
    add_trace(1.0, h[old], trace)
    for slot in range(count):
        slope = real(laws.slopes[number, slot])
        if slope != 0:
            out = slots[old, slot]
            for q in range(points):
                out[q] += slope * trace[q]
    c[new], slots[new] = 0, 0
    if d == 3:
        for i in range(1, k // 2 + 1):
            add_cross_product(0.5 if 2 * i == k else 1.0, h[i - 1], h[new - i], c[new])
    for i in range(1, k):
        add_contraction(i / k, h[i - 1], c[k - i - 1], slots[new, THETA - 1])
    if laws.first_varies[number]:
        for i in range(1, k):
            add_contraction(1.0, h[i - 1], h[new - i], slots[new, I1])
    if second:
        x = terms.x[load, row]
        if old == 0:
            x[0] = 0
        _add_turned(h[old], x[old])
        x[new] = 0
        add_linear_cofactors(c[new], x[new])
        add_trace(2.0, c[new], slots[new, I2])
        for i in range(1, k):
            add_contraction(1.0, c[i - 1], c[new - i], slots[new, I2])
            if d == 3:
                add_cross_product(1.0, c[i - 1], h[new - i], x[new])
    next_coefficients(k, number, laws, slots)
    stress[:] = 0
    for which in range(3):
        place = tapes.outputs[number, which]
        if which == 1 and not second:
            continue
        factor = 1.0 if which == 2 else 2.0
        at_rest = tapes.fixed[number, which] if place < 0 else laws.rest[number, place]
        if which > 0:  # the part of order k, and what of I is in those of order 0
            part = c[new] if which == 2 else terms.x[load, row, new]
            scale = real(factor * at_rest)
            for a in range(d):
                for b in range(d):
                    for q in range(points):
                        stress[a, b, q] += scale * part[a, b, q]
        if place < 0:
            continue
        scale = real(factor)
        for j in range(1, k):
            by = slots[new - j, place]
            for a in range(d):
                for b in range(d):
                    if which == 0:
                        part_row = h[j - 1, a, b]
                    elif which == 2:
                        part_row = c[j - 1, a, b]
                    else:
                        part_row = terms.x[load, row, j - 1, a, b]
                    for q in range(points):
                        stress[a, b, q] += scale * by[q] * part_row[q]
        unit = real(2 * factor if which == 1 else factor)
        by = slots[new, place]
        for a in range(d):
            for q in range(points):
                stress[a, a, q] += unit * by[q]


@inner
def _add_turned(h: Array, out: Array) -> None:
    """Add cof(H) × I + I × H, with the linear cofactors of H: (d, d, n_points) → same."""
    turned = np.zeros_like(h)
    add_linear_cofactors(h, turned)
    add_linear_cofactors(turned, out)
    add_linear_cofactors(h, out)


@inner
def add_term(k: int, cells: Cells, laws: Laws, u: Array, terms: Terms, forces: Array) -> None:
    """Set Hₖ, and add the forces of what it adds to the next stress, turned around.

    Parameters
    ----------
    k : int
        All orders in turn; there are no forces after the last one.
    cells : Cells
    laws : Laws
    u, forces : array, (N, n_nodes, d)
        uₖ in m, and output.
    terms : Terms
    """
    blocks, points, corners, d, row = cells.gradients.shape
    order, unit = terms.h.shape[2], u.dtype.type(-cells.unit)
    values, stress = np.empty((2, corners, d, row), u.dtype), np.empty((d, d, row), u.dtype)
    of_corners, of_forces = values[0], values[1]
    for block in range(blocks):
        number = cells.laws[block]
        for load in range(len(u)):  # in turn, while the gradients of a block are in the cache
            at_corners(cells.nodes[block], u[load], of_corners)
            of_forces[:] = 0
            for p in range(points):
                place, gradients = block * points + p, cells.gradients[block, p]
                slopes_of(gradients, of_corners, terms.h[load, place, k - 1])
                if k < order:
                    next_stress(k + 1, terms, load, place, number, laws, stress)
                    for i in range(d):
                        for j in range(d):
                            for q in range(row):
                                stress[i, j, q] *= unit * cells.volumes[place, q]
                    add_forces(gradients, stress, of_forces)
            if k < order:
                add_at_nodes(cells.nodes[block], of_forces, forces[load])
