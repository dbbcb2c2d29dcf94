"""Sums of the matrices of single cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array


def sum_of_cells(
    matrices: NDArray[np.float64], cells: NDArray[np.int64], unknowns: int
) -> csr_array:
    """Assemble the matrices of all cells.

    Parameters
    ----------
    matrices : array, (n_cells, m, m)
    cells : array of int, (n_cells, m)
        Unknowns of every cell.
    unknowns : int
        Number of rows and columns of the result.
    """
    size = cells.shape[1]
    rows, columns = np.repeat(cells, size, axis=1), np.tile(cells, size)
    shape = (unknowns, unknowns)
    return coo_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()
