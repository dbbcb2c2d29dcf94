r"""The load series, compiled: the combination of its terms that has the least energy.

The terms are those of `surrogate.mechanics.series.compiled_terms`, with the weights of
`surrogate.mechanics.series.compiled_weights`, cell by cell; on small bodies
`surrogate.mechanics.series.small_series` takes less time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import DTypeLike

from surrogate.mechanics.compiled.cells import Cells
from surrogate.mechanics.compiled.fields import Array, compiled, inner, largest
from surrogate.mechanics.compiled.program import Doubles, Programs
from surrogate.mechanics.compiled.solid import fibre_components
from surrogate.mechanics.series.compiled_terms import Terms, add_term, room_for_terms
from surrogate.mechanics.series.compiled_weights import least_energy, potential_of_terms
from surrogate.mechanics.solids.solid import Solid

SMALL = 1e-5  # gradients whose sum of terms, all weights 1, is right to rounding
SOLVED = 16  # loads that are solved for together: 10 MB each on 4000 nodes in space


class SeriesBody(NamedTuple):
    """Cells and materials of a body.

    Attributes
    ----------
    cells : Cells
    stress, energy : Programs
        Of P; of P, J and the energy density.
    fibres : array, (n_blocks, families · d, n)
    moduli : array, (2, n_laws)
        Shear modulus and energy density at rest.
    """

    cells: Cells
    stress: Programs
    energy: Programs
    fibres: Array
    moduli: Array

    @classmethod
    def of(cls, solid: Solid, precision: DTypeLike) -> SeriesBody:
        """Arrange a solid's, in a precision; energies have a unit of its own.

        Energies of a body of micrometres would underflow in single precision: the unit of volumes
        is a power of two near their mean.
        """
        volumes = solid.volumes.numpy()
        unit = 2.0 ** round(math.log2(volumes.mean()))
        arrays = solid.gradients.numpy().swapaxes(1, 2), volumes / unit
        gradients, shares = (np.ascontiguousarray(each, precision) for each in arrays)
        numbers = solid.material_of_cells().numpy()
        cells = Cells.of(solid.cells.numpy(), gradients, shares, unit, numbers)
        laws, rest = solid.recorded_laws, [law.energy_at_rest for law in solid.laws]
        moduli = np.array([[material.lame_mu for material in solid.materials], rest])
        stress = Programs.of(laws, 0, ["stress"])
        energy = Programs.of(laws, 0, ["stress", "volume", "energy"])
        return cls(cells, stress, energy, cells.of_cells(fibre_components(solid)), moduli)


@inner
def weights_of(terms: Terms, load: int, body: SeriesBody, rounding: float) -> Doubles:
    """Weights of the terms of a load, (n,): 1 if H₁ is small, else those of the least energy."""
    found = 0.0
    square = body.cells.gradients.shape[3] ** 2
    for row in range(terms.kept.shape[1]):
        found = max(found, largest(terms.kept[load, row, 0, :square].ravel()))
    if found <= SMALL:
        return np.ones(terms.kept.shape[2])
    of = body.cells, body.energy, body.fibres, body.moduli
    return least_energy(potential_of_terms(terms.kept[load], *of), rounding)


add_next_term, weights_of_load = compiled(add_term), compiled(weights_of)


class CompiledSeries:
    """Load series of a body, cell by cell.

    Parameters
    ----------
    solid : Solid
        Elements without a dilation of their own.
    precision : data type
        Of all fields.
    respond : callable
        K⁻¹ of forces in N to displacements in m, (N, n_points, d) in that precision.
    order : int
        Order n.
    """

    def __init__(
        self, solid: Solid, precision: DTypeLike, respond: Callable[[Array], Array], order: int
    ) -> None:
        self.body, self.respond, self.order = SeriesBody.of(solid, precision), respond, order
        self.precision = precision

    def of_forces(self, forces: Array) -> tuple[Array, Array]:
        """Return displacements in m, (N, n_points, d), and largest ones of the last term, (N,).

        Both in double precision, of forces in N.
        """
        first = self.respond(forces.astype(self.precision))
        beyond, term = self(first)
        last = np.linalg.norm(term, axis=2).max(axis=1)
        return (first + beyond).astype(np.float64), last.astype(np.float64)

    def __call__(self, first: Array) -> tuple[Array, Array]:
        """Response beyond u₁, and its last term, of u₁: (N, n_points, d) in m → same.

        Threads share the loads; every load is the same to the last bit for any number of them.
        """
        if len(first) == 0:
            return first.copy(), first.copy()
        some = min(SOLVED, len(first))
        room = room_for_terms(some, self.order, self.body.cells, self.body.stress)
        parts = [
            self._of_some(some, room.of(slice(len(some))))
            for some in np.split(first, range(SOLVED, len(first), SOLVED))
        ]
        beyond, last = zip(*parts, strict=True)
        return np.concatenate(beyond), np.concatenate(last)

    def _of_some(self, first: Array, terms: Terms) -> tuple[Array, Array]:
        """The same of a few, with room for their terms."""
        body, count = self.body, len(first)
        order, eps = self.order, float(np.finfo(first.dtype).eps)
        every, forces = np.zeros((order, *first.shape), first.dtype), np.zeros_like(first)
        every[0], c = first, np.ones((count, order))

        def add(k: int, some: slice) -> None:
            add_next_term(
                k,
                body.cells,
                body.stress,
                body.fibres,
                every[k - 1, some],
                terms.of(some),
                forces[some],
            )

        def combine(some: slice) -> None:
            for n in range(some.start, some.stop):
                c[n] = weights_of_load(terms, n, self.body, eps)

        for k in range(1, order + 1):
            if k > 1:
                every[k - 1] = self.respond(forces)
                forces[:] = 0
            in_threads(partial(add, k), count)
        in_threads(combine, count)
        last = c[:, -1, None, None].astype(first.dtype) * every[-1]
        c[:, 0] -= 1
        return np.einsum("nk,knid->nid", c.astype(first.dtype), every), last


def in_threads(work: Callable[[slice], object], loads: int, least: int = 1) -> None:
    """Do the work on slices of some loads, in as many threads as PyTorch has.

    Parameters
    ----------
    work : callable
        Takes a slice of the loads; all time is spent in compiled code.
    loads : int
        Number of loads.
    least : int
        Loads of a thread, at least: those of small bodies take less time than its start.
    """
    threads = max(1, min(torch.get_num_threads(), loads // least))
    if threads == 1:
        work(slice(0, loads))
        return
    share = -(-loads // threads)
    shares = [slice(start, min(start + share, loads)) for start in range(0, loads, share)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, shares))
