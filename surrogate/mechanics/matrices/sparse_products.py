"""Products with sparse matrices as PyTorch modules."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn


class SparseProduct(nn.Module):
    """Product with a sparse matrix: (columns, N) → (rows, N).

    Every row is as long as the longest one, padded by weights of zero. Few operations, since a file
    of many takes minutes to write.
    """

    columns: Tensor
    weights: Tensor

    def __init__(self, matrix: csr_array, dtype: torch.dtype) -> None:
        super().__init__()
        counts = np.diff(matrix.indptr)
        place = np.arange(matrix.nnz) - np.repeat(matrix.indptr[:-1], counts)
        row = np.repeat(np.arange(len(counts)), counts)
        self.shape = max(1, int(counts.max(initial=1))), len(counts)
        columns, weights = np.zeros(self.shape, np.int32), np.zeros(self.shape)
        columns[place, row], weights[place, row] = matrix.indices, matrix.data
        self.register_buffer("columns", torch.from_numpy(columns.ravel()), persistent=False)
        values = torch.from_numpy(weights).to(dtype)[:, :, None]
        self.register_buffer("weights", values, persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """Multiply."""
        terms = x.index_select(0, self.columns).reshape(*self.shape, -1)
        return (terms * self.weights).sum(0)


class WeightedSums(nn.Module):
    """A sparse linear map of the last axis: every output is a weighted sum of a few inputs.

    Parameters
    ----------
    matrix : csr_array, (n_out, n_in)
    dtype : torch.dtype
        Precision of the weights.

    Attributes
    ----------
    selects : bool
        Whether every output is one input at most.
    """

    def __init__(self, matrix: csr_array, dtype: torch.dtype = torch.float32) -> None:
        super().__init__()
        self.product = SparseProduct(matrix, dtype)
        self.selects = len(self.product.weights) == 1

    def forward(self, values: Tensor) -> Tensor:
        """Apply the map: (…, n_in) → (…, n_out)."""
        if self.selects:
            return values.index_select(-1, self.product.columns) * self.product.weights[0, :, 0]
        rows = values.reshape(-1, values.shape[-1]).T.contiguous()  # whole rows are fast to select
        sums: Tensor = self.product(rows).T
        return sums.reshape(*values.shape[:-1], sums.shape[-1])


def matrix_of(sources: NDArray[Any], weights: NDArray[np.float64], columns: int) -> csr_array:
    """Matrix (n_out, columns) of rows with as many entries each, without those of weight zero.

    Parameters
    ----------
    sources : array of int, (n_out, k)
        Column of every entry; any number where the weight is zero.
    weights : array, (n_out, k)
    columns : int
    """
    row, place = np.nonzero(weights)
    starts = np.searchsorted(row, np.arange(len(weights) + 1))
    entries = weights[row, place], sources[row, place], starts
    return csr_array(entries, shape=(len(weights), columns))
