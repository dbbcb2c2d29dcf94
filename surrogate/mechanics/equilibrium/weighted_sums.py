"""Sparse linear maps as PyTorch modules, and their transposes."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array
from torch import Tensor, nn

AT_ONCE = 24  # fields whose terms are held at once on a CPU: in the cache
IN_SCIPY = (torch.float32, torch.float64)


class WeightedSums(nn.Module):
    """A sparse linear map: every output is a weighted sum of a few inputs.

    On a CPU, where no gradients are needed, SciPy applies it: it knows the zeros of the padding.

    Parameters
    ----------
    sources : array of int, (n_out, k)
        Numbers of the inputs of each output.
    weights : array, (n_out, k)
        Weights of these inputs.
    dtype : torch.dtype
        Precision of the weights.
    """

    sources: Tensor
    weights: Tensor

    def __init__(
        self,
        sources: NDArray[np.int64] | NDArray[np.int32],
        weights: NDArray[np.float64],
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        values = torch.from_numpy(np.array(weights.T)).to(dtype)
        self.register_buffer("sources", torch.from_numpy(sources.T.flatten()), persistent=False)
        self.register_buffer("weights", values, persistent=False)
        places = np.repeat(np.arange(len(sources)), sources.shape[1])
        entries = weights.ravel(), (places, sources.ravel())
        used = 1 + int(sources.max(initial=0))
        self._matrix = csr_array(entries, (len(sources), used)).astype(values.numpy().dtype)
        self._matrix.eliminate_zeros()

    def forward(self, values: Tensor) -> Tensor:
        """Apply the map: (…, n_in) → (…, n_out)."""
        if values.device.type == "cpu" and not torch.compiler.is_compiling():
            flat = values.reshape(-1, values.shape[-1])
            if values.dtype in IN_SCIPY and not (torch.is_grad_enabled() and values.requires_grad):
                sums = self._in_scipy(flat.detach())
                return sums.reshape(*values.shape[:-1], sums.shape[-1])
            if len(flat) > AT_ONCE:
                sums = torch.cat([self(part) for part in torch.split(flat, AT_ONCE)])
                return sums.reshape(*values.shape[:-1], sums.shape[-1])
        count, leading = self.weights.shape, values.shape[:-1]
        rows = values.reshape(-1, values.shape[-1]).T.contiguous()  # whole rows are fast to select
        terms = rows.index_select(0, self.sources).reshape(*count, -1)
        sums = (terms * self.weights[:, :, None]).sum(dim=0)
        return sums.T.reshape(*leading, count[1])

    def _in_scipy(self, values: Tensor) -> Tensor:
        """Apply the map: (N, n_in) → (N, n_out)."""
        if len(self.weights) == 1:
            return values.index_select(1, self.sources) * self.weights[0]
        rows = values[:, : self._matrix.shape[1]].T.contiguous().numpy()
        return torch.from_numpy((self._matrix @ rows).T)


def transposed(
    sources: NDArray[np.int64], weights: NDArray[np.float64], columns: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Transpose a sparse map.

    Parameters
    ----------
    sources : array of int, (n_out, k)
    weights : array, (n_out, k)
    columns : int
        Number of inputs n_in.

    Returns
    -------
    sources, weights : array, (n_in, m)
        Transposed map in the same form; shorter rows are padded with weights of zero.
    """
    starts = np.arange(0, sources.size + 1, sources.shape[1])
    shape = (len(sources), columns)
    matrix = csr_array((weights.ravel(), sources.ravel(), starts), shape=shape, copy=True)
    matrix.eliminate_zeros()
    return padded_rows(matrix.tocsc().T)  # in rows, with ascending column numbers


def padded_rows(matrix: csr_array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return columns and weights of every row, padded to the longest row by weights of zero.

    Parameters
    ----------
    matrix : csr_array, (n_out, n_in)

    Returns
    -------
    sources, weights : array, (n_out, k)
    """
    counts = np.diff(matrix.indptr)
    shape = (len(counts), int(counts.max(initial=1)))
    sources, weights = np.zeros(shape, dtype=np.int64), np.zeros(shape)
    row = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(matrix.nnz) - np.repeat(matrix.indptr[:-1], counts)
    sources[row, place], weights[row, place] = matrix.indices, matrix.data
    return sources, weights
