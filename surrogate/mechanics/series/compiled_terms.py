r"""Terms of the load series, compiled: programs of the laws, run with power series, row by row.

.. math:: F = I + \sum_k s^k H_k, \qquad P = \sum_k s^k P_k

All coefficients of order k depend on :math:`H_k` linearly. So the part of :math:`P_k` that follows
from the terms before is that with :math:`H_k = 0`. Of every order, the slots that higher ones
depend on are kept.
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
from surrogate.mechanics.compiled.fields import Array, inner
from surrogate.mechanics.compiled.program import Programs
from surrogate.mechanics.compiled.run import Flags, begin, run


class Terms(NamedTuple):
    """Terms k = 1, 2, … of the fields of N series, in rows k - 1, at rows of points.

    Attributes
    ----------
    kept : array, (N, n_rows, n, n_kept, n_points)
        Slots that are kept, Hₖ first.
    known : array of bool, (N, n_laws, n + 2, n_slots)
        Which slots are not zero, of order 0 and more; the same for all loads.
    """

    kept: Array
    known: Flags

    def of(self, loads: slice) -> Terms:
        """Those of some loads."""
        return Terms(self.kept[loads], self.known[loads])


def room_for_terms(loads: int, order: int, cells: Cells, programs: Programs) -> Terms:
    """Make room for the terms of some loads: by NumPy, which asks for large pages of memory."""
    rows, laws = len(cells.volumes), len(programs.outputs)
    shape = loads, rows, order, programs.kept.shape[1], cells.row
    known = np.zeros((loads, laws, order + 2, programs.slots), np.bool_)
    return Terms(np.empty(shape, cells.gradients.dtype), known)


@inner
def undeformed(
    programs: Programs, law: int, d: int, fibres: Array, values: Array, known: Flags
) -> None:
    """Write the slots of order 0 of the undeformed body, of directions (n_components, n)."""
    begin(values, known)
    for i in range(d):
        known[0, 1 + i * d + i], values[0, 1 + i * d + i] = True, 1
    for i in range(len(fibres)):
        known[0, 1 + d * d + i], values[0, 1 + d * d + i] = True, fibres[i]
    run(programs, law, 0, values, known)


@inner
def add_term(
    k: int, cells: Cells, programs: Programs, fibres: Array, u: Array, terms: Terms, forces: Array
) -> None:
    """Set Hₖ, and add the forces of what it adds to the next stress, turned around.

    Parameters
    ----------
    k : int
        All orders in turn; there are no forces after the last one.
    cells : Cells
    programs : Programs
        Of stresses.
    fibres : array, (n_blocks, n_components, n)
    u, forces : array, (N, n_nodes, d)
        uₖ in m, and output.
    terms : Terms
    """
    blocks, points, corners, d, row = cells.gradients.shape
    order, unit = terms.kept.shape[2], u.dtype.type(-cells.unit)
    values, stress = np.empty((2, corners, d, row), u.dtype), np.empty((d, d, row), u.dtype)
    of_corners, of_forces = values[0], values[1]
    slots, h = np.empty((k + 2, programs.slots, row), u.dtype), np.empty((d, d, row), u.dtype)
    last = -1
    for block in range(blocks):
        law = cells.laws[block]
        known, kept, outputs = terms.known[0, law], programs.kept[law], programs.outputs[law]
        if (law != last or len(fibres[block])) and k < order:
            undeformed(programs, law, d, fibres[block], slots, known[:1])
            last = law
        for load in range(len(u)):  # in turn, while the gradients of a block are in the cache
            at_corners(cells.nodes[block], u[load], of_corners)
            of_forces[:] = 0
            for p in range(points):
                place, gradients = block * points + p, cells.gradients[block, p]
                slopes_of(gradients, of_corners, h)
                of_row = terms.kept[load, place]
                for i in range(d * d):
                    of_row[k - 1, i] = h[i // d, i % d]
                if k == order:
                    continue
                for i in range(1, k):
                    for n in range(len(kept)):
                        if known[i, kept[n]]:
                            slots[i, kept[n]] = of_row[i - 1, n]
                for i in range(d * d):
                    slots[k, 1 + i] = of_row[k - 1, i]
                    known[k, 1 + i], known[k + 1, 1 + i] = True, False
                run(programs, law, k, slots, known)
                for n in range(d * d, len(kept)):
                    if known[k, kept[n]]:
                        of_row[k - 1, n] = slots[k, kept[n]]
                run(programs, law, k + 1, slots, known)
                for i in range(d):
                    for j in range(d):
                        out = outputs[i * d + j]
                        stress[i, j] = 0
                        if known[k + 1, out]:
                            for q in range(row):
                                stress[i, j, q] = (
                                    unit * cells.volumes[place, q] * slots[k + 1, out, q]
                                )
                add_forces(gradients, stress, of_forces)
            if k < order:
                add_at_nodes(cells.nodes[block], of_forces, forces[load])
    for load in range(1, len(u)):
        terms.known[load] = terms.known[0]
