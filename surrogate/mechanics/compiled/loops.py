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
from surrogate.mechanics.compiled.fields import Array, compiled, inner
from surrogate.mechanics.compiled.program import Doubles, Numbers, Programs
from surrogate.mechanics.compiled.run import begin, run

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
def add_viscous_forces(cells: Cells, viscosity: Array, u: Array, v: Array, out: Array) -> None:
    """Add the forces of F S with S = η sym(Fᵀ ∇v), η by blocks: (n_nodes, d) twice → same."""
    blocks, points, corners, d, row = cells.gradients.shape
    of_corners = np.empty((3, corners, d, row))
    tensors = np.empty((4, d, d, row))
    f, rate, stress, piola = tensors[0], tensors[1], tensors[2], tensors[3]
    for block in range(blocks):
        at_corners(cells.nodes[block], u, of_corners[0])
        at_corners(cells.nodes[block], v, of_corners[1])
        of_corners[2] = 0
        for p in range(points):
            gradients = cells.gradients[block, p]
            slopes_of(gradients, of_corners[0], f)
            slopes_of(gradients, of_corners[1], rate)
            stress[:], piola[:] = 0, 0
            for i in range(d):
                for q in range(row):
                    f[i, i, q] += 1
            volumes, eta = cells.volumes[block * points + p], viscosity[block]
            for j in range(d):
                for k in range(d):
                    for i in range(d):
                        for q in range(row):
                            half = volumes[q] * eta[q] / 2
                            work = f[i, j, q] * rate[i, k, q] + f[i, k, q] * rate[i, j, q]
                            stress[j, k, q] += half * work
            for i in range(d):
                for k in range(d):
                    for j in range(d):
                        for q in range(row):
                            piola[i, k, q] += f[i, j, q] * stress[j, k, q]
            add_forces(gradients, piola, of_corners[2])
        add_at_nodes(cells.nodes[block], of_corners[2], out)


@compiled
def deform(cells: Cells, u: Array, f: Array) -> None:
    """Write F: (n_nodes, d) → (n_rows, d, d, n)."""
    slopes_at(cells, u, f)
    for place in range(len(f)):
        for i in range(f.shape[1]):
            for q in range(f.shape[3]):
                f[place, i, i, q] += 1


@inner
def _set_inputs(f: Array, fibres: Array, beside: Array, values: Array) -> None:
    """Write the inputs of a row: F, directions of fibres, and what an element has beside."""
    d, slot = len(f), 1
    for i in range(d):
        for j in range(d):
            values[slot] = f[i, j]
            slot += 1
    for i in range(len(fibres)):
        values[slot] = fibres[i]
        slot += 1
    for i in range(len(beside)):
        values[slot] = beside[i]
        slot += 1


@compiled
def outputs_of(
    cells: Cells, programs: Programs, fibres: Array, f: Array, beside: Array, out: Array
) -> None:
    """Write the outputs of programs at all points.

    Parameters
    ----------
    cells : Cells
    programs : Programs
    fibres : array, (n_blocks, n_components, n)
    f : array, (n_rows, d, d, n)
    beside : array, (n_rows, 0, 1 or 2, n)
        θ and p, as far as there are some; none is taken that is not given.
    out : array, (n_rows, n_outputs, n)
    """
    per_cell = cells.gradients.shape[1]
    values = np.zeros((1, programs.slots, f.shape[3]))
    known = np.empty((1, programs.slots), np.bool_)
    begin(values, known)
    known[0, : programs.inputs] = True
    for place in range(len(f)):
        block = place // per_cell
        law = cells.laws[block]
        _set_inputs(f[place], fibres[block], beside[place], values[0])
        run(programs, law, 0, values, known)
        for i in range(out.shape[1]):
            out[place, i] = values[0, programs.outputs[law, i]]


@compiled
def stress_and_forces(
    cells: Cells, programs: Programs, fibres: Array, u: Array, f: Array, piola: Array, out: Array
) -> bool:
    """Write F and P, and add forces, in one go; whether J is positive and finite everywhere.

    Parameters
    ----------
    cells, programs, fibres
        As of `outputs_of`, of J and P.
    u, out : array, (n_nodes, d)
    f, piola : array, (n_rows, d, d, n)
    """
    blocks, points, corners, d, row = cells.gradients.shape
    of_corners, forces = np.empty((corners, d, row)), np.empty((corners, d, row))
    weighted, beside, inside = np.empty((d, d, row)), np.empty((0, row)), True
    values, known = np.zeros((1, programs.slots, row)), np.empty((1, programs.slots), np.bool_)
    begin(values, known)
    known[0, : programs.inputs] = True
    for block in range(blocks):
        law = cells.laws[block]
        at_corners(cells.nodes[block], u, of_corners)
        forces[:] = 0
        for p in range(points):
            place = block * points + p
            slopes_of(cells.gradients[block, p], of_corners, f[place])
            for i in range(d):
                for q in range(row):
                    f[place, i, i, q] += 1
            _set_inputs(f[place], fibres[block], beside, values[0])
            run(programs, law, 0, values, known)
            j, volumes = values[0, programs.outputs[law, 0]], cells.volumes[place]
            for q in range(row):
                inside &= 0 < j[q] < np.inf
            for i in range(d):
                for k in range(d):
                    stress = values[0, programs.outputs[law, 1 + i * d + k]]
                    for q in range(row):
                        piola[place, i, k, q] = stress[q]
                        weighted[i, k, q] = volumes[q] * stress[q]
            add_forces(cells.gradients[block, p], weighted, forces)
        add_at_nodes(cells.nodes[block], forces, out)
    return inside


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
    programs: Programs,
    fibres: Array,
    f: Array,
    beside: Array,
    out: Array,
    of_beside: Array,
) -> None:
    r"""Add the tangents of all cells at fixed θ and p.

    .. math:: K_{aibk} = \sum_q w_q G_{aj} \mathbb{A}_{ijkl} G_{bl}

    Parameters
    ----------
    cells, programs, fibres, f, beside
        As of `outputs_of`, of derivatives by F and what is beside.
    out : array, (n_cells, n_corners d, n_corners d)
    of_beside : array, (n_rows, 2 d² + 1, n), or no rows
        Also written: derivatives of P by θ, and by p, then ∂²W/∂θ².
    """
    blocks, points, _, d, row = cells.gradients.shape
    corners, square = out.shape[1] // d, d * d
    changing = square + beside.shape[1]
    values = np.empty((2, programs.slots, row))
    known = np.empty((2, programs.slots), np.bool_)
    begin(values, known)
    known[0, : programs.inputs] = True
    a = np.empty((changing, square + 1, row))
    of_point, g = np.empty((square, square)), np.empty((corners, d))
    turned = np.empty((d, d, corners * d))
    for place in range(blocks * points):
        block = place // points
        p, law = place - block * points, cells.laws[block]
        _set_inputs(f[place], fibres[block], beside[place], values[0])
        run(programs, law, 0, values, known)
        for x in range(changing):
            slot = 1 + x if x < square else programs.inputs - changing + x
            values[1, slot], known[1, slot] = 1, True
            run(programs, law, 1, values, known)
            known[1, slot] = False
            for y in range(square if x < square else square + 1):
                by = programs.outputs[law, y]
                for q in range(row):
                    a[x, y, q] = values[1, by, q] if known[1, by] else 0.0
        for x in range(square, changing):
            of_beside[place, (x - square) * square : (x - square + 1) * square] = a[x, :square]
        if changing > square:
            of_beside[place, 2 * square] = a[square, square]
        for q, cell in enumerate(cells.numbers[block]):
            if cell < 0:
                break
            volume = cells.volumes[place, q]
            for x in range(square):
                for y in range(square):
                    of_point[x, y] = volume * a[x, y, q]
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
                        total += stress[place, i * d + j, q] * cells.gradients[block, p, b, j, q]
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
