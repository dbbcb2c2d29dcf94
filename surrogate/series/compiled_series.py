r"""The load series, compiled: terms of the stress, their combination, the response.

`next_stress` is the recursion of `surrogate.series.stress_series`. `small_series` and, cell by cell
on a large body, `CompiledResponse` go on to the combination :math:`\sum_k c_k u_k` of
`surrogate.series.series_response`.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compliance import Compliance
from surrogate.series.compiled_cells import (
    Cells,
    add_at_nodes,
    add_forces,
    at_corners,
    slopes_of,
)
from surrogate.series.compiled_energy import least_energy, potential_of_terms
from surrogate.series.compiled_fields import (
    Array,
    add_contraction,
    add_cross_product,
    add_linear_cofactors,
    add_multiple,
    add_trace,
    add_weighted_rows,
    add_weighted_sums,
    compiled,
    largest,
    longest,
)
from surrogate.series.load_threads import in_threads
from surrogate.series.series_response import NEGLIGIBLE, CellOperators
from surrogate.series.stress_series import Factors

EPS = float(np.finfo(np.float64).eps)
SOLVED = 16  # loads that are solved for together: 10 MB each on 4000 nodes in space
SparseMap = tuple[NDArray[np.int64], Array]  # sources, weights


class Terms(NamedTuple):
    """Terms k = 1, 2, … of the fields of N series, in rows k - 1, at rows of points.

    Attributes
    ----------
    h : array, (N, n_rows, n, d, d, n_points)
        Hₖ.
    c : array, (N, n_rows, n, d, d, n_points)
        Cₖ.
    j, r, s : array, (N, n_rows, n, n_points)
        Jₖ, Rₖ, sₖ.
    """

    h: Array
    c: Array
    j: Array
    r: Array
    s: Array

    def of(self, loads: slice) -> Terms:
        """Those of some loads."""
        return Terms(*(field[loads] for field in self))


def room_for_terms(loads: int, order: int, cells: Cells) -> Terms:
    """Make room for the terms of some loads: by NumPy, which asks for large pages of memory."""
    blocks, points, _, d, row = cells.gradients.shape
    rows, numbers = blocks * points, cells.gradients
    fields = np.empty((2, loads, rows, order, d, d, row), numbers.dtype)
    scalars = np.empty((3, loads, rows, order, row), numbers.dtype)
    return Terms(fields[0], fields[1], scalars[0], scalars[1], scalars[2])


@compiled
def next_stress(k: int, terms: Terms, load: int, row: int, factors: Factors, stress: Array) -> None:
    r"""Complete the terms k - 1 from their H, and begin those of order k as if :math:`H_k = 0`.

    Parameters
    ----------
    k : int
        2 at least; all orders from 2 on, in turn.
    terms : Terms
    load, row : int
        Numbers of the series and of the row of points.
    factors : Factors
    stress : array, (d, d, n_points)
        Output: :math:`P_k` without the part that is linear in :math:`H_k`.
    """
    h, c = terms.h[load, row], terms.c[load, row]
    j, r, s = terms.j[load, row], terms.r[load, row], terms.s[load, row]
    d, points = h.shape[1], h.shape[3]
    new, old = k - 1, k - 2
    mu, growth, decay = factors
    of_f, of_j, of_r = h.dtype.type(mu), h.dtype.type(growth), h.dtype.type(decay)
    if old == 0:
        c[0], j[0], r[0] = 0, 0, 0
    c[new], j[new] = 0, 0
    add_linear_cofactors(h[old], c[old])
    add_trace(1.0, h[old], j[old])
    add_trace(-1.0, h[old], r[old])
    for i in range(1, k):
        add_contraction(i / k, h[i - 1], c[k - i - 1], j[new])
    for q in range(points):
        s[old, q] = of_j * j[old, q] - of_r * r[old, q]
        r[new, q] = -j[new, q]
    for i in range(k - 1):
        for q in range(points):
            r[new, q] -= j[i, q] * r[old - i, q]
    for q in range(points):
        s[new, q] = of_j * j[new, q] - of_r * r[new, q]
    if d == 3:
        for i in range(1, k // 2 + 1):
            add_cross_product(0.5 if 2 * i == k else 1.0, h[i - 1], h[new - i], c[new])
    for a in range(d):
        for b in range(d):
            for q in range(points):
                stress[a, b, q] = -of_f * c[new, a, b, q]
            for i in range(k - 1):
                for q in range(points):
                    stress[a, b, q] += s[old - i, q] * c[i, a, b, q]
        for q in range(points):
            stress[a, a, q] += s[new, q]


@compiled
def add_term(k: int, cells: Cells, factors: Factors, u: Array, terms: Terms, forces: Array) -> None:
    """Set Hₖ, and add the forces of what it adds to the next stress, turned around.

    Parameters
    ----------
    k : int
        All orders in turn; there are no forces after the last one.
    cells : Cells
    factors : Factors
    u, forces : array, (N, n_nodes, d)
        uₖ in m, and output.
    terms : Terms
    """
    blocks, points, corners, d, row = cells.gradients.shape
    order, unit = terms.h.shape[2], u.dtype.type(-cells.unit)
    values, stress = np.empty((2, corners, d, row), u.dtype), np.empty((d, d, row), u.dtype)
    of_corners, of_forces = values[0], values[1]
    for block in range(blocks):
        for load in range(len(u)):  # in turn, while the gradients of a block are in the cache
            at_corners(cells.nodes[block], u[load], of_corners)
            of_forces[:] = 0
            for p in range(points):
                number, gradients = block * points + p, cells.gradients[block, p]
                slopes_of(gradients, of_corners, terms.h[load, number, k - 1])
                if k < order:
                    next_stress(k + 1, terms, load, number, factors, stress)
                    for i in range(d):
                        for j in range(d):
                            for q in range(row):
                                stress[i, j, q] *= unit * cells.volumes[number, q]
                    add_forces(gradients, stress, of_forces)
            if k < order:
                add_at_nodes(cells.nodes[block], of_forces, forces[load])


@compiled
def is_negligible(terms: Terms, load: int, rounding: float) -> bool:
    """Tell whether what is beyond u₁ is lost in a relative rounding, from H₁."""
    found = 0.0
    for row in range(terms.h.shape[1]):
        found = max(found, largest(terms.h[load, row, 0].ravel()))
    return found <= NEGLIGIBLE * rounding


def cells_of(higher: CellOperators) -> Cells:
    """Cells of a body on the CPU, in the precision of its fields."""
    count, corners, columns = higher.slopes.shape
    points = len(higher.volumes) // count
    gradients = higher.slopes.numpy().reshape(count, corners, points, columns // points)
    unit = float(higher.volumes[0]) / float(higher.shares[0])
    return Cells.of(higher.cells.numpy(), gradients, higher.shares.numpy().reshape(count, -1), unit)


class SmallOperators(NamedTuple):
    """Linear maps of a small body, in double precision.

    Attributes
    ----------
    response : array, (n_dofs, n_dofs)
        Rows: displacements in m under unit forces.
    cells : Cells
    on_grid : tuple of array, (k, n_grid_points · d²) each
        From displacements to their gradients on the grid: sources and weights for
        `add_weighted_sums`.
    """

    response: Array
    cells: Cells
    on_grid: SparseMap


@compiled
def small_series(
    loads: Array, body: SmallOperators, factors: Factors, terms: Terms
) -> tuple[Array, Array, Array]:
    r"""Find :math:`\sum_k c_k u_k` on a small body, and the gradient and size of its last term.

    Parameters
    ----------
    loads : array, (N, n_nodes, d)
        In N.
    body : SmallOperators
    factors : Factors
    terms : Terms
        Room for those of one load.

    Returns
    -------
    displacements : array, (N, n_nodes, d)
        In m.
    gradients : array, (N, n_grid_points · d²)
    lengths : array, (N,)
        Largest displacement of a node in the last term, in m.
    """
    displacements, lengths = np.zeros(loads.shape), np.zeros(len(loads))
    gradients, order = np.zeros((len(loads), body.on_grid[1].shape[1])), terms.h.shape[2]
    for load in range(len(loads)):
        u, c = np.zeros((order, 1, *loads.shape[1:])), np.zeros(order)
        forces = loads[load : load + 1].copy()
        c[0] = 1.0
        for k in range(order):
            add_weighted_rows(forces.ravel(), body.response, u[k].ravel())
            forces[:] = 0
            add_term(k + 1, body.cells, factors, u[k], terms, forces)
            if k == 0 and is_negligible(terms, 0, EPS):
                break
        else:
            potential = potential_of_terms(terms.h[0], body.cells.volumes, factors)
            c = least_energy(potential, EPS)
        for k in range(order):
            add_multiple(c[k], u[k].ravel(), displacements[load].ravel())
        last = c[order - 1] * u[order - 1].ravel()
        add_weighted_sums(*body.on_grid, last, gradients[load])
        lengths[load] = abs(c[order - 1]) * longest(u[order - 1, 0])
    return displacements, gradients, lengths


class CompiledResponse:
    """What `SeriesResponse.beyond_first` finds, cell by cell.

    Parameters
    ----------
    higher : CellOperators
        On the CPU; its precision is that of all fields.
    compliance : Compliance
    order : int
        Order n.
    """

    def __init__(self, higher: CellOperators, compliance: Compliance, order: int) -> None:
        self.factors, self.compliance, self.order = Factors.of(higher.material), compliance, order
        self.cells = cells_of(higher)

    def __call__(self, first: Array) -> tuple[Array, Array]:
        """Response beyond u₁, and its last term, of u₁: (N, n_nodes, d) in m → same.

        Threads share the loads; every load is the same to the last bit for any number of them.
        """
        room = room_for_terms(min(SOLVED, len(first)), self.order, self.cells)
        parts = [
            self._of_some(some, room.of(slice(len(some))))
            for some in np.split(first, range(SOLVED, len(first), SOLVED))
        ]
        beyond, last = zip(*parts, strict=True)
        return np.concatenate(beyond), np.concatenate(last)

    def _of_some(self, first: Array, terms: Terms) -> tuple[Array, Array]:
        """The same of a few, with room for their terms."""
        count, order, eps = len(first), self.order, float(np.finfo(first.dtype).eps)
        every, forces = np.zeros((order, *first.shape), first.dtype), np.zeros_like(first)
        every[0], seen, c = first, np.empty(count, bool), np.eye(1, order).repeat(count, axis=0)

        def add(k: int, some: slice) -> None:
            u = every[k - 1, some]
            add_term(k, self.cells, self.factors, u, terms.of(some), forces[some])

        def begin(some: slice) -> None:
            add(1, some)
            for n in range(some.start, some.stop):
                seen[n] = not is_negligible(terms, n, eps)

        def combine(some: slice) -> None:
            for n in range(some.start, some.stop):
                if seen[n]:
                    potential = potential_of_terms(terms.h[n], self.cells.volumes, self.factors)
                    c[n] = least_energy(potential, eps)

        in_threads(begin, count)
        for k in range(2, order + 1) if seen.any() else ():
            every[k - 1, seen] = self.compliance.respond_at_nodes(forces[seen])
            forces[:] = 0
            in_threads(partial(add, k), count)
        in_threads(combine, count)
        last = c[:, -1, None, None].astype(first.dtype) * every[-1]
        c[:, 0] -= 1
        return np.einsum("nk,knid->nid", c.astype(first.dtype), every), last
