r"""The load series of a small body: K⁻¹ is a matrix, and a load is one call of compiled code.

A single load takes a twentieth of the time of PyTorch on the small shipped bodies, or less
(`docs/benchmarks/trained.md`): calls take longest there, not sums.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.fields import (
    Array,
    add_multiple,
    add_weighted_rows,
    compiled,
    longest,
)
from surrogate.mechanics.series.compiled_series import SeriesBody, in_threads, weights_of
from surrogate.mechanics.series.compiled_terms import Terms, add_term, room_for_terms
from surrogate.mechanics.solids.solid import Solid

MOST = 2**22  # products of degrees of freedom and values of a field: 32 MB
OF_A_THREAD = 8  # loads, at least
EPS = float(np.finfo(np.float64).eps)
Doubles = NDArray[np.float64]


class SmallBody(NamedTuple):
    """A small body in double precision.

    Attributes
    ----------
    response : array, (n_dofs, n_dofs)
        Rows: displacements in m under unit forces.
    body : SeriesBody
    """

    response: Array
    body: SeriesBody


class SmallSeries:
    """Forces in N to displacements in m by the load series.

    Parameters
    ----------
    solid : Solid
        For which `fits` is true: elements without a dilation of their own.
    response : array, (n_points · d, n_points · d)
        Rows: displacements of all points in m under unit forces.
    order : int
        Order n.
    """

    def __init__(self, solid: Solid, response: Doubles, order: int) -> None:
        self.body, self.order = SmallBody(response, SeriesBody.of(solid, np.float64)), order

    @staticmethod
    def fits(solid: Solid, size: int) -> bool:
        """Whether matrix and fields of a body with so many degrees of freedom are small."""
        return max(size, solid.volumes.numel() * solid.gradients.shape[3] ** 2) * size <= MOST

    def __call__(self, forces: Doubles) -> tuple[Doubles, Doubles]:
        """Return displacements, (N, n_points, d), and largest ones of the last term, (N,)."""
        u, lengths = np.empty(forces.shape), np.empty(len(forces))

        def find(some: slice) -> None:
            body = self.body.body
            terms = room_for_terms(1, self.order, body.cells, body.stress)
            u[some], lengths[some] = small_series(forces[some], self.body, terms)

        in_threads(find, len(forces), OF_A_THREAD)
        return u, lengths


@compiled
def small_series(loads: Array, small: SmallBody, terms: Terms) -> tuple[Array, Array]:
    r"""Find :math:`\sum_k c_k u_k` on a small body, and the size of its last term.

    Parameters
    ----------
    loads : array, (N, n_points, d)
        In N.
    small : SmallBody
    terms : Terms
        Room for those of one load.

    Returns
    -------
    displacements : array, (N, n_points, d)
        In m.
    lengths : array, (N,)
        Largest displacement of a point in the last term, in m.
    """
    body = small.body
    displacements, lengths = np.zeros(loads.shape), np.zeros(len(loads))
    order = terms.kept.shape[2]
    for load in range(len(loads)):
        u = np.zeros((order, 1, *loads.shape[1:]))
        forces = loads[load : load + 1].copy()
        for k in range(order):
            add_weighted_rows(forces.ravel(), small.response, u[k].ravel())
            forces[:] = 0
            add_term(k + 1, body.cells, body.stress, body.fibres, u[k], terms, forces)
        c = weights_of(terms, 0, small.body, EPS)
        for k in range(order):
            add_multiple(c[k], u[k].ravel(), displacements[load].ravel())
        lengths[load] = abs(c[order - 1]) * longest(u[order - 1, 0])
    return displacements, lengths
