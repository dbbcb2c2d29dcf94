r"""Sparse matrices of a body, stored and solved as bands.

The free nodes are renumbered so that neighbours have near numbers: by the method of Cuthill and
McKee (1969), reversed, or along the coordinate axis that gives a narrower band. All entries then
lie within a distance b of the diagonal, and the factorisation of Cholesky takes n b² operations.
LAPACK's ``pbtrf`` does them at the speed of dense matrices, and it fails exactly where a matrix is
not positive definite, that is where an equilibrium is not stable. A matrix that is not symmetric is
factorised by ``gbtrf``, Gauss's elimination with pivoting, in about five times the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.linalg.lapack import dgbtrf, dgbtrs, dpbtrf
from scipy.sparse.csgraph import reverse_cuthill_mckee
from torch import Tensor

from surrogate.mechanics.matrices.cell_matrices import sum_of_cells

Array = NDArray[np.float64]
Values = NDArray[Any]  # in single or double precision
MANY, WIDE = 4, 16  # right-hand sides, and diagonals, from which on blocks are faster
BLOCK = 128  # columns of a block


class BandLayout:
    """Places of the entries of cell matrices in the band of the free degrees of freedom.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    held : array of bool, (n_nodes, m)
        Components that are no degrees of freedom; m is d for displacements, 1 for scalars.

    Attributes
    ----------
    dofs : array of int, (n,)
        Free degrees of freedom, node · m + component, in the order of the band.
    width : int
        Number b of diagonals below the main one.
    """

    def __init__(
        self, coordinates: Array, cells: NDArray[np.int64], held: NDArray[np.bool_]
    ) -> None:
        d = held.shape[1]
        self.dofs, self.width = band_order(coordinates, cells, held)
        self._cells, self._dimension, self._place = cells, d, np.full(held.size, -1)
        self._place[self.dofs] = np.arange(len(self.dofs))

    @property
    def entries(self) -> int:
        """Number of entries of a band."""
        return len(self.dofs) * (self.width + 1)

    def assembled(self, cell_matrices: Tensor) -> Array:
        """Add cell matrices (N, n_cells, m, m) into bands (N, n, b + 1), column by column.

        Entry [k, j, i] is entry (j + i, j) of matrix k.
        """
        n, rows = len(cell_matrices), self.width + 1
        kept, places = self._kept_and_places
        entries = cell_matrices.reshape(n, -1)[:, kept]
        bands = torch.zeros(n, len(self.dofs) * rows, dtype=cell_matrices.dtype)
        bands.index_add_(1, places, entries)
        return bands.reshape(n, -1, rows).numpy()

    @cached_property
    def _kept_and_places(self) -> tuple[Tensor, Tensor]:
        """Entries of cell matrices below the diagonal, and their places, column by column."""
        row, column = self._rows_and_columns(self._cells)
        kept = (column >= 0) & (row >= column)
        places = (column * self.width + row)[kept]
        return torch.from_numpy(np.flatnonzero(kept)), torch.from_numpy(places)

    def add(self, band: Array, parts: NDArray[np.int64], blocks: Array) -> None:
        """Add matrices of facets, (n_facets, m, m), to a band (n, b + 1): their symmetric part."""
        row, column = self._rows_and_columns(parts)
        kept = (column >= 0) & (row >= column)
        symmetric = (blocks + blocks.transpose(0, 2, 1)) / 2
        np.add.at(band, (column[kept], (row - column)[kept]), symmetric[kept])

    def add_skew(self, full: Array, parts: NDArray[np.int64], blocks: Array) -> None:
        """Add the rest of what `add` has added to a band of `unfolded`."""
        row, column = self._rows_and_columns(parts)
        kept = (column >= 0) & (row >= 0)
        skew = (blocks - blocks.transpose(0, 2, 1)) / 2
        np.add.at(full, (column[kept], (2 * self.width + row - column)[kept]), skew[kept])

    def factor(self, band: Array) -> BandCholesky | None:
        """Factorise a band, which is overwritten; None if the matrix is not positive definite."""
        return BandCholesky.of(band)

    def diagonal(self, band: Array) -> Array:
        """Diagonal of a band."""
        return band[:, 0].copy()

    def on_springs(self, band: Array, springs: Array) -> Array:
        """The band with more stiffness on its diagonal, (n,)."""
        stiffer = band.copy()
        stiffer[:, 0] += springs
        return stiffer

    def with_facets(self, band: Array, facets: NDArray[np.int64], blocks: Array) -> Array:
        """The band, which is changed, with the symmetric part of matrices of facets."""
        self.add(band, facets, blocks)
        return band

    def under_pressure(
        self, band: Array, surfaces: Sequence[tuple[NDArray[np.int64], Array]]
    ) -> tuple[BandLU | None, bool]:
        """Factorise the sum of a band, which is overwritten, and matrices of facets.

        None if it is singular; the second result says whether its symmetric part is definite.
        """
        for facets, blocks in surfaces:
            self.add(band, facets, blocks)
        full = unfolded(band)
        for facets, blocks in surfaces:
            self.add_skew(full, facets, blocks)
        return BandLU.of(full), BandCholesky.of(band) is not None

    def _rows_and_columns(
        self, parts: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Place in the band of the entries of the matrices of cells or facets; -1 where held."""
        d = self._dimension
        dofs = (parts[:, :, None] * d + np.arange(d)).reshape(len(parts), parts.shape[1] * d)
        row, column = np.broadcast_arrays(
            self._place[dofs][:, :, None], self._place[dofs][:, None, :]
        )
        return row, column


def band_order(
    coordinates: Array, cells: NDArray[np.int64], held: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], int]:
    """`dofs` and `width` of the `BandLayout` of these arguments."""
    d = held.shape[1]
    free = np.flatnonzero(~held.all(axis=1))
    order, distance = _narrow_order(coordinates, cells, free)
    dofs = (order[:, None] * d + np.arange(d)).ravel()
    return dofs[~held.ravel()[dofs]], distance * d + d - 1


def _narrow_order(
    coordinates: Array, cells: NDArray[np.int64], free: NDArray[np.int64]
) -> tuple[NDArray[np.int64], int]:
    """Order of the free nodes with the narrowest band; largest distance of neighbours in it."""
    corners = cells.shape[1]
    graph = sum_of_cells(np.ones((len(cells), corners, corners)), cells, len(coordinates))
    graph = graph[free][:, free].tocoo()
    orders = [reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True)]
    axes = np.arange(coordinates.shape[1])
    places = np.round(coordinates[free] / np.ptp(coordinates, axis=0).max(), 9)  # equal ones tie
    orders += [np.lexsort(places[:, np.roll(axes, shift)].T) for shift in axes]
    best: tuple[NDArray[np.int64], int] | None = None
    for order in orders:
        place = np.empty(len(free), dtype=np.int64)
        place[order] = np.arange(len(free))
        distance = int(np.abs(place[graph.row] - place[graph.col]).max(initial=0))
        if best is None or distance < best[1]:
            best = free[order], distance
    assert best is not None
    return best


def unfolded(band: Array) -> Array:
    """Both triangles of a band (n, b + 1), with room for its factors: (n, 3 b + 1).

    Entry [j, 2 b + i] is entry (j + i, j) of the matrix.
    """
    n, rows = band.shape
    b = rows - 1
    full = np.zeros((n, 3 * b + 1))
    full[:, 2 * b :] = band
    for i in range(1, min(rows, n)):
        full[i:, 2 * b - i] = band[: n - i, i]
    return full


@dataclass(frozen=True)
class BandLU:
    """The factors of A = P L U.

    Attributes
    ----------
    factors : array, (3 b + 1, n)
        LAPACK's general band storage.
    pivots : array of int, (n,)
    """

    factors: Array
    pivots: NDArray[np.int32]

    @classmethod
    def of(cls, full: Array) -> BandLU | None:
        """Factorise a band of `unfolded`, which is overwritten; None if the matrix is singular."""
        width = (full.shape[1] - 1) // 3
        factors, pivots, info = dgbtrf(full.T, width, width, overwrite_ab=1)
        return cls(factors, pivots) if info == 0 else None

    def solve(self, right: Values) -> Values:
        """A⁻¹ b: (n,) or (n, m) → same."""
        width = (len(self.factors) - 1) // 3
        solution: Values = dgbtrs(self.factors, width, width, right, self.pivots)[0]
        return solution.reshape(right.shape)


@dataclass(frozen=True)
class BandCholesky:
    """The factor L of A = L Lᵀ.

    Attributes
    ----------
    factor : array, (b + 1, n)
        LAPACK's lower band storage; its precision is that of all solutions.
    """

    factor: Values

    @property
    def width(self) -> int:
        """Number b of diagonals below the main one."""
        return len(self.factor) - 1

    @cached_property
    def single(self) -> BandCholesky:
        """The same factor in single precision; it is read, and so solves, in half the time."""
        return BandCholesky(np.asfortranarray(self.factor, np.float32))

    @cached_property
    def _blocks(self) -> list[tuple[Values, Values]]:
        """Blocks of L, from the first rows to the last: inverse of that on the diagonal, and below.

        With inverses all of a solve is products of one library: those of NumPy and SciPy, each with
        threads that wait for work, would take the cores from each other.
        """
        (trtri,) = get_lapack_funcs(("trtri",), (self.factor,))
        rows, n = self.factor.shape
        size, blocks = min(BLOCK, self.width), []
        for start in range(0, n, size):
            end, below = min(start + size, n), min(start + size + self.width, n)
            columns = self.factor[:, start:end]
            both = np.zeros((below - start, end - start), self.factor.dtype, order="F")
            for j in range(end - start):
                length = min(rows, below - start - j)
                both[j : j + length, j] = columns[:length, j]
            inverse = trtri(both[: end - start], lower=1)[0]
            blocks.append((inverse, both[end - start :]))
        return blocks

    @classmethod
    def of(cls, band: Array) -> BandCholesky | None:
        """Factorise a band (n, b + 1) of `BandLayout`, which is overwritten.

        None if the matrix is not positive definite.
        """
        factor, info = dpbtrf(band.T, lower=1, overwrite_ab=1)
        return cls(factor) if info == 0 else None

    def solve(self, right: Values) -> Values:
        """A⁻¹ b: (n,) or (n, m) → same; many right-hand sides are solved for block by block."""
        if right.ndim == 1 or right.shape[1] < MANY or len(self.factor) < WIDE:
            (pbtrs,) = get_lapack_funcs(("pbtrs",), (self.factor,))
            return pbtrs(self.factor, right, lower=1)[0]
        x, start = np.array(right, self.factor.dtype, order="C"), 0
        for inverse, below in self._blocks:  # L y = b
            end = start + len(inverse)
            x[start:end] = inverse @ x[start:end]
            x[end : end + len(below)] -= below @ x[start:end]
            start = end
        for inverse, below in reversed(self._blocks):  # Lᵀ x = y
            end, start = start, start - len(inverse)
            x[start:end] = inverse.T @ (x[start:end] - below.T @ x[end : end + len(below)])
        return x
