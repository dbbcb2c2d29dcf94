"""Loops over the cells of a body, compiled: from displacements to forces and tangents.

Fields at the quadrature points are rows, one after the other, in the order of
`surrogate.mechanics.compiled.cells`: tensors (n_rows, d, d, n), scalars (n_rows, n). The dilation θ
and the pressure p of elements without one of their own have no rows.
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
from surrogate.mechanics.compiled.fields import Array, add_contraction, compiled, inner
from surrogate.mechanics.compiled.measures import (
    THETA,
    J,
    add_derivative,
    cofactors,
    measure,
    moduli,
    pair,
    weight,
)
from surrogate.mechanics.compiled.tapes import Doubles, Numbers, Tapes, values_of

TINY = 1e-300  # no division by zero


class Functions(NamedTuple):
    """Functions on which J and ∂W/∂θ are projected (`surrogate.mechanics.solids.solid`).

    Attributes
    ----------
    numbers : array of int, (n_cells, n_functions of a cell)
        Those of every cell.
    values : array, (n_rows, n_functions of a cell, n)
        At the points.
    """

    numbers: Numbers
    values: Doubles


@compiled
def slopes_at(cells: Cells, u: Array, out: Array) -> None:
    """Write ∇u: (n_nodes, d) → (n_rows, d, d, n)."""
    blocks, points, corners, d, row = cells.gradients.shape
    of_corners = np.empty((corners, d, row), u.dtype)
    for block in range(blocks):
        at_corners(cells.nodes[block], u, of_corners)
        for p in range(points):
            slopes_of(cells.gradients[block, p], of_corners, out[block * points + p])


@compiled
def add_forces_of(cells: Cells, stress: Array, out: Array) -> None:
    """Add Σ_q w_q P_q ∇N_a: (n_rows, d, d, n) → (n_nodes, d)."""
    blocks, points, corners, d, row = cells.gradients.shape
    of_corners, weighted = np.empty((corners, d, row), out.dtype), np.empty_like(stress[0])
    for block in range(blocks):
        of_corners[:] = 0
        for p in range(points):
            place = block * points + p
            for i in range(d):
                for j in range(d):
                    for q in range(row):
                        weighted[i, j, q] = cells.volumes[place, q] * stress[place, i, j, q]
            add_forces(cells.gradients[block, p], weighted, of_corners)
        add_at_nodes(cells.nodes[block], of_corners, out)


@compiled
def deform(cells: Cells, u: Array, f: Array, j: Array) -> bool:
    """Write F and J, and tell whether J is positive and finite everywhere: (n_nodes, d) → rows."""
    slopes_at(cells, u, f)
    cof, inside = np.empty_like(f[0]), True
    for place in range(len(f)):
        for i in range(f.shape[1]):
            for q in range(f.shape[3]):
                f[place, i, i, q] += 1
        cofactors(f[place], cof)
        j[place] = 0
        add_contraction(1 / f.shape[1], f[place], cof, j[place])
        for q in range(f.shape[3]):
            inside &= 0 < j[place, q] < np.inf
    return inside


@inner
def _values(
    tapes: Tapes,
    number: int,
    f: Array,
    cof: Array,
    fibres: Array,
    j: Array,
    dilation: Array,
    slots: Doubles,
) -> None:
    """Write cof F and the values of a tape at a row."""
    cofactors(f, cof)
    measure(f, cof, fibres, tapes.inputs[number], slots)
    for q in range(len(j)):
        slots[J, q], slots[THETA, q] = j[q], dilation[q]
    values_of(number, tapes, slots)


@compiled
def stresses(
    cells: Cells,
    fibres: Array,
    tapes: Tapes,
    f: Array,
    j: Array,
    dilation: Array,
    piola: Array,
    slope: Array,
) -> None:
    """Write P without p, and ∂W/∂θ where there is θ, of the stress tapes.

    Parameters
    ----------
    cells : Cells
    fibres : array, (n_blocks, families, d, n)
    tapes : Tapes
    f, j, dilation, piola, slope
        Rows; without θ, `dilation` is J, and `slope` has no rows.
    """
    _, d, _, row = f.shape
    per_cell = cells.gradients.shape[1]
    cof, parts, by = np.empty((d, d, row)), np.empty((2, d, d, row)), np.empty(row)
    slots = np.empty((tapes.slots, row))
    for place in range(len(f)):
        block, at = place // per_cell, f[place]
        number = cells.laws[block]
        _values(tapes, number, at, cof, fibres[block], j[place], dilation[place], slots)
        piola[place] = 0
        for a in range(tapes.inputs[number]):
            if weight(tapes, number, a, slots, by):
                add_derivative(a, by, at, cof, fibres[block], parts, piola[place])
        if len(slope):
            weight(tapes, number, THETA, slots, slope[place])


@compiled
def add_pressures(f: Array, pressure: Array, piola: Array) -> None:
    """Add p cof F: rows."""
    cof = np.empty_like(f[0])
    for place in range(len(f)):
        cofactors(f[place], cof)
        for i in range(len(cof)):
            for j in range(len(cof)):
                for q in range(cof.shape[2]):
                    piola[place, i, j, q] += pressure[place, q] * cof[i, j, q]


@compiled
def mean(cells: Cells, block: int, values: Array, out: Array) -> None:
    """Write the means over the cells of a block, 0 beside: rows → (d, d, n)."""
    points, (d, _, row) = cells.gradients.shape[1], out.shape
    volume = np.full(row, TINY)
    for p in range(points):
        for q in range(row):
            volume[q] += cells.volumes[block * points + p, q]
    for i in range(d):
        for j in range(d):
            total = out[i, j]
            total[:] = 0
            for p in range(points):
                weights, part = cells.volumes[block * points + p], values[block * points + p, i, j]
                for q in range(row):
                    total[q] += weights[q] / volume[q] * part[q]


@compiled
def sums(cells: Cells, functions: Functions, values: Array, out: Array) -> None:
    """Add Σ_q w_q N_a v: rows → (n_functions,)."""
    per_cell = cells.gradients.shape[1]
    for place in range(len(values)):
        for q, cell in enumerate(cells.numbers[place // per_cell]):
            if cell >= 0:
                weighted = cells.volumes[place, q] * values[place, q]
                for a, function in enumerate(functions.numbers[cell]):
                    out[function] += weighted * functions.values[place, a, q]


@compiled
def spread(cells: Cells, functions: Functions, of_functions: Array, out: Array) -> bool:
    """Write Σ_a N_a v_a, 1 beside the cells; whether all are positive: (n_functions,) → rows."""
    per_cell, inside = cells.gradients.shape[1], True
    for place in range(len(out)):
        for q, cell in enumerate(cells.numbers[place // per_cell]):
            total = 1.0
            if cell >= 0:
                total = 0.0
                for a, function in enumerate(functions.numbers[cell]):
                    total += of_functions[function] * functions.values[place, a, q]
            out[place, q] = total
            inside &= 0 < total < np.inf
    return inside


@compiled
def tangents(
    cells: Cells,
    fibres: Array,
    tapes: Tapes,
    f: Array,
    j: Array,
    dilation: Array,
    pressure: Array,
    mixed: Array,
    curvature: Array,
    out: Array,
) -> None:
    r"""Add the tangents of all cells at fixed θ and p, of the tapes of energies.

    .. math:: K_{aibk} = \sum_q w_q G_{aj} \mathbb{A}_{ijkl} G_{bl}

    Parameters
    ----------
    cells, fibres, tapes, f, j, dilation
        As of `stresses`.
    pressure, mixed, curvature
        Rows of p, and, as output, of ∂²W/∂F∂θ and ∂²W/∂θ², where there is θ.
    out : array, (n_cells, n_corners d, n_corners d)
    """
    blocks, points, _, d, row = cells.gradients.shape
    corners = out.shape[1] // d
    cof, parts, by = np.empty((d, d, row)), np.empty((4, d, d, row)), np.empty(row)
    slots, a = np.empty((tapes.slots, row)), np.empty((d, d, d, d, row))
    of_point, g = np.empty((d * d, d * d)), np.empty((corners, d))
    turned, none = np.empty((d, d, corners * d)), np.empty(0)
    for place in range(blocks * points):
        block, at = place // points, f[place]
        p, number, count = place - block * points, cells.laws[block], 0
        _values(tapes, number, at, cof, fibres[block], j[place], dilation[place], slots)
        at_point = pressure[place] if len(pressure) else none
        moduli(tapes, number, slots, at_point, at, cof, fibres[block], parts, a)
        if len(mixed):
            mixed[place], count = 0, tapes.inputs[number]
            for b in range(count):
                if weight(tapes, number, pair(count, b, THETA), slots, by):
                    add_derivative(b, by, at, cof, fibres[block], parts, mixed[place])
            weight(tapes, number, pair(count, THETA, THETA), slots, curvature[place])
        rows = a.reshape(d * d, d * d, row)
        for q, cell in enumerate(cells.numbers[block]):
            if cell < 0:
                break
            volume = cells.volumes[place, q]
            for x in range(d * d):
                for y in range(d * d):
                    of_point[x, y] = volume * rows[x, y, q]
            for b in range(corners):
                for k in range(d):
                    g[b, k] = cells.gradients[block, p, b, k, q]
            _add_tangent(of_point, g, turned, out[cell])


@inner
def _add_tangent(a: Doubles, g: Doubles, turned: Doubles, out: Doubles) -> None:
    """Add G A G of a point: (d², d²), (n_corners, d) → (n_corners d, n_corners d).

    Rows of `turned`, (d, d, n_corners d), are of j and i, so that loops are long.
    """
    corners, d = g.shape
    for i in range(d):
        for j in range(d):
            row, x = turned[j, i], a[i * d + j]
            if d == 3:
                for b in range(corners):
                    g0, g1, g2 = g[b, 0], g[b, 1], g[b, 2]
                    row[3 * b] = x[0] * g0 + x[1] * g1 + x[2] * g2
                    row[3 * b + 1] = x[3] * g0 + x[4] * g1 + x[5] * g2
                    row[3 * b + 2] = x[6] * g0 + x[7] * g1 + x[8] * g2
            else:
                for b in range(corners):
                    g0, g1 = g[b, 0], g[b, 1]
                    row[2 * b] = x[0] * g0 + x[1] * g1
                    row[2 * b + 1] = x[2] * g0 + x[3] * g1
    one, other, third = turned[0].ravel(), turned[1].ravel(), turned[d - 1].ravel()
    for b in range(corners):
        total = out[b * d : (b + 1) * d].ravel()
        if d == 3:
            for y in range(len(total)):
                total[y] += g[b, 0] * one[y] + g[b, 1] * other[y] + g[b, 2] * third[y]
        else:
            for y in range(len(total)):
                total[y] += g[b, 0] * one[y] + g[b, 1] * other[y]


@compiled
def add_works(cells: Cells, functions: Functions, stress: Array, out: Array) -> None:
    """Add the works of stresses that functions multiply: → (n_cells, n_corners d, n_functions)."""
    _, points, _, d, _ = cells.gradients.shape
    for place in range(len(stress)):
        block = place // points
        p = place - block * points
        for q, cell in enumerate(cells.numbers[block]):
            if cell < 0:
                break
            for b in range(out.shape[1] // d):
                for i in range(d):
                    total = 0.0
                    for j in range(d):
                        total += stress[place, i, j, q] * cells.gradients[block, p, b, j, q]
                    total *= cells.volumes[place, q]
                    for a in range(out.shape[2]):
                        out[cell, b * d + i, a] += total * functions.values[place, a, q]


@compiled
def add_squares(cells: Cells, functions: Functions, values: Array, out: Array) -> None:
    """Add Σ_q w_q v N_a N_b of every cell: rows → (n_cells, n_functions, n_functions)."""
    per_cell = cells.gradients.shape[1]
    for place in range(len(values)):
        for q, cell in enumerate(cells.numbers[place // per_cell]):
            if cell < 0:
                break
            weighted = cells.volumes[place, q] * values[place, q]
            for a in range(out.shape[1]):
                for b in range(out.shape[1]):
                    of_both = functions.values[place, a, q] * functions.values[place, b, q]
                    out[cell, a, b] += weighted * of_both
