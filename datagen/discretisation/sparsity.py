"""Sparsity of the matrices that cells couple, and the places of their entries in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc


@dataclass(frozen=True)
class Sparsity:
    """Compressed rows of a matrix that couples all degrees of freedom of every cell.

    Attributes
    ----------
    indptr, indices : array of int
        Row pointers and column indices, columns ascending in every row.
    places : array of int32, (n_cells, n_dofs²)
        Index of each entry of each element matrix among the values; one past the end if its row or
        column is dropped.
    diagonal : array of int, (n_rows,)
        Index of the diagonal entry of every row among the values.
    """

    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    places: NDArray[np.int32]
    diagonal: NDArray[np.intp]


def sparsity(
    dofs: NDArray[np.int32],
    size: int,
    block_size: int,
    dropped_rows: NDArray[np.bool_],
    dropped_columns: NDArray[np.bool_],
) -> Sparsity:
    """Find the sparsity of a matrix.

    Parameters
    ----------
    dofs : array of int32, (n_cells, n_dofs)
        Degrees of freedom of every cell, in whole blocks.
    size : int
        Number of rows.
    block_size : int
        Number of consecutive degrees of freedom that every cell couples alike.
    dropped_rows, dropped_columns : array of bool, (size,)
        Degrees of freedom whose rows, or columns, are not assembled.
    """
    blocks = dofs[:, ::block_size] // block_size
    rows, per_row = size // block_size, blocks.shape[1]
    keys = blocks[:, :, None].astype(np.int64) * rows + blocks[:, None, :]
    found = np.unique(keys)
    starts = np.searchsorted(found, np.arange(rows + 1, dtype=np.int64) * rows)
    columns = found % rows
    width = np.diff(starts)  # number of blocks in every row of blocks

    lengths = np.repeat(width * block_size, block_size)
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    inner = np.arange(block_size)
    in_rows = np.repeat(np.arange(rows), width)
    # The entry (i, j) of the k-th block of row r of blocks is at
    # b² starts[r] + i b width[r] + b (k - starts[r]) + j.
    first = block_size**2 * starts[in_rows] + block_size * (np.arange(len(found)) - starts[in_rows])
    stride = block_size * width[in_rows]
    indices = np.empty(indptr[-1], dtype=PETSc.IntType)
    for i in range(block_size):
        for j in range(block_size):
            indices[first + i * stride + j] = columns * block_size + j

    block = np.searchsorted(found, keys)
    at = (
        first[block][:, :, None, :, None]
        + stride[block][:, :, None, :, None] * (inner[:, None, None])
    )
    places = (at + inner).reshape(len(dofs), per_row * block_size, per_row * block_size)
    places[dropped_rows[dofs][:, :, None] | dropped_columns[dofs][:, None, :]] = len(indices)
    row_of = np.repeat(np.arange(size), lengths)
    return Sparsity(
        indptr.astype(PETSc.IntType),
        indices,
        np.ascontiguousarray(places.reshape(len(dofs), -1), dtype=np.int32),
        np.flatnonzero(row_of == indices),
    )
