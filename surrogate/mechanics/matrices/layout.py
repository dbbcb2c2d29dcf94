"""Places of the unknowns of a body in its tangents, and their factors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from torch import Tensor

from surrogate.mechanics.matrices.factors import (
    BandCholesky,
    BandLU,
    Factor,
    Pardiso,
    Solver,
    SparseFactor,
    SymmetricFactor,
    band_order,
    dofs_of_least_degree,
    general_lu,
    has_pardiso,
    super_lu,
    tell_of_pardiso,
)

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
MOST = 2**27  # entries of a band: 1 GB
ROUNDING = 1e-13  # of the largest entry
LARGE = 20_000  # unknowns, from which on SuperLU takes many seconds


class Layout:
    """Places of the unknowns of a body in its tangents.

    A tangent is an array of the values at its places, (n_entries,), column by column. Its factor is
    that of a band where this has a width, and sparse otherwise.

    Parameters
    ----------
    cells : array of int, (n_cells, m)
        Number of the unknown of each row of a cell's matrix.
    order : array of int, (n,)
        The unknowns that are not held, in the order of the rows.
    size : int
        Number of all unknowns.
    width : int, optional
        Number b of diagonals below the main one of a band.
    displacements : int, optional
        Number of the unknowns that are displacements, point · d + component; they are the first. By
        default all are.
    negative : int
        Number of negative eigenvalues that a matrix has if its K is positive definite.
    units : array, (m, m), optional
        Factors on the entries of a cell's matrix.
    beside : sequence of array of int, (n, k)
        Unknowns of other matrices that are added to tangents, those of cables.

    Attributes
    ----------
    dofs : array of int
        Free degrees of freedom of the displacement, in the order of the rows.
    width : int or None
    """

    def __init__(
        self,
        cells: Numbers,
        order: Numbers,
        size: int,
        width: int | None = None,
        *,
        displacements: int | None = None,
        negative: int = 0,
        units: Array | None = None,
        beside: Sequence[Numbers] = (),
    ) -> None:
        self._beside = beside
        self.width, self._cells, self._size = width, cells, len(order)
        self._negative, self._units = negative, units
        self._row = np.full(size, -1)
        self._row[order] = np.arange(len(order))
        self._rows_of_displacements = np.flatnonzero(
            order < (size if displacements is None else displacements)
        )
        self.dofs = order[self._rows_of_displacements]

    @classmethod
    def of(
        cls,
        coordinates: Array,
        cells: Numbers,
        held: NDArray[np.bool_],
        beside: Sequence[Numbers] = (),
    ) -> Layout:
        """Layout of K, as a band unless that would be large.

        Parameters
        ----------
        coordinates : array, (n_nodes, d)
            In m.
        cells : array of int, (n_cells, n_corners)
        held : array of bool, (n_nodes, m)
            Components that are no degrees of freedom; m is d for displacements, 1 for scalars.
        beside : sequence of array of int, (n, k)
            Nodes of other matrices that are added to K.
        """
        m = held.shape[1]
        numbers, others = unknowns_of(cells, m), [unknowns_of(nodes, m) for nodes in beside]
        dofs, width = band_order(coordinates, cells, held)
        row = np.full(held.size, -1)
        row[dofs] = np.arange(len(dofs))
        for rows in (row[other[row[other] >= 0]] for other in others):
            width = max(width, int(np.ptp(rows)) if len(rows) else 0)
        if len(dofs) * (width + 1) <= MOST:
            return cls(numbers, dofs, held.size, width, beside=others)
        dofs = np.flatnonzero(~held) if has_pardiso() else dofs_of_least_degree(cells, held)
        return cls(numbers, dofs, held.size, beside=others)

    def assembled(self, cell_matrices: Tensor) -> list[Array]:
        """Add cell matrices (N, n_cells, m, m) into N tangents."""
        matrices, (kept, places) = cell_matrices.numpy(), self._kept_and_places
        if self._units is not None:
            matrices = matrices * self._units
        return [
            np.bincount(places, each.ravel()[kept], minlength=len(self._entries)).astype(each.dtype)
            for each in matrices
        ]

    def matrix(self, tangent: Array) -> csc_array:
        """A tangent as a matrix, (n, n)."""
        columns, rows = np.divmod(self._entries, self._size)
        starts = np.searchsorted(columns, np.arange(self._size + 1))
        return csc_array((tangent, rows, starts), shape=(self._size, self._size))

    def factor(self, tangent: Array) -> SymmetricFactor | None:
        """Factorise a symmetric tangent; None unless K is positive definite."""
        if self.width is not None:
            lower, places = self._band
            band = np.zeros((self._size, self.width + 1))
            band.ravel()[places] = tangent[lower]
            return BandCholesky.of(band)
        matrix, displacements = self.matrix(tangent), self._rows_of_displacements
        if has_pardiso():
            solver: Solver | None = Pardiso.of(matrix, self._negative)
        else:
            if self._size > LARGE:
                tell_of_pardiso(self._size)
            solver = super_lu(matrix, self._negative)
        if solver is None:
            return None
        factor = SparseFactor(solver, matrix, displacements)
        return factor if isinstance(solver, Pardiso) or factor.is_accurate() else None

    def under_following(
        self, tangent: Array, parts: Iterable[tuple[Numbers, Array]]
    ) -> tuple[Factor | None, bool]:
        """Factorise a tangent with those of following loads; say if its symmetric part is definite.

        Where these loads have a potential, the tangent is symmetric. None if it is singular.
        """
        for points, blocks in parts:
            tangent = self.with_blocks(tangent, points, blocks)
        column, row = np.divmod(self._entries, self._size)
        mirrored = np.searchsorted(self._entries, row * self._size + column)
        symmetric = (tangent + tangent[mirrored]) / 2
        factor = self.factor(symmetric)
        stable, skew = factor is not None, np.abs(tangent - symmetric).max(initial=0)
        if stable and skew <= ROUNDING * np.abs(tangent).max(initial=0):
            return factor, stable
        if (b := self.width) is not None:
            band = np.zeros((self._size, 3 * b + 1))
            band[column, 2 * b + row - column] = tangent
            return BandLU.of(band), stable
        return general_lu(self.matrix(tangent), self._rows_of_displacements), stable

    def diagonal(self, tangent: Array) -> Array:
        """Diagonal at `dofs`."""
        return np.asarray(tangent[self._diagonal])

    def on_springs(self, tangent: Array, springs: Array) -> Array:
        """The tangent with more stiffness on the diagonal, (n,), at `dofs`."""
        stiffer = tangent.copy()
        stiffer[self._diagonal] += springs
        return stiffer

    def with_blocks(self, tangent: Array, points: Numbers, blocks: Array) -> Array:
        """The tangent with matrices of some points each, (n, k) and (n, k d, k d)."""
        if len(points) == 0:
            return tangent
        numbers = unknowns_of(points, blocks.shape[1] // points.shape[1])
        kept, entries = self._kept_entries(numbers)
        found = tangent.copy()
        np.add.at(found, np.searchsorted(self._entries, entries), blocks.ravel()[kept])
        return found

    def _kept_entries(self, numbers: Numbers) -> tuple[Numbers, Numbers]:
        """Entries of matrices of unknowns that are not held, and column · n + row of each."""
        at = self._row[numbers]
        row, column = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        return kept, (column.ravel()[kept] * self._size + row.ravel()[kept])

    @cached_property
    def _entries(self) -> Numbers:
        """Places of a tangent's values, column · n + row, ascending."""
        of_all = [self._kept_entries(numbers)[1] for numbers in (self._cells, *self._beside)]
        return np.unique(np.concatenate(of_all))

    @cached_property
    def _kept_and_places(self) -> tuple[Numbers, Numbers]:
        """Entries of the cells' matrices, and the places of their values in a tangent."""
        kept, entries = self._kept_entries(self._cells)
        return kept, np.searchsorted(self._entries, entries)

    @cached_property
    def _band(self) -> tuple[Numbers, Numbers]:
        """Values below the diagonal, and their places in the band (n, b + 1), column by column."""
        assert self.width is not None
        column, row = np.divmod(self._entries, self._size)
        lower = np.flatnonzero(row >= column)
        return lower, (column * self.width + row)[lower]

    @cached_property
    def _diagonal(self) -> Numbers:
        rows = self._rows_of_displacements
        return np.searchsorted(self._entries, rows * (self._size + 1))


def unknowns_of(points: Numbers, m: int) -> Numbers:
    """Unknowns of points, point · m + component: (n, k) → (n, k · m)."""
    return np.asarray((points[:, :, None] * m + np.arange(m)).reshape(len(points), -1))
