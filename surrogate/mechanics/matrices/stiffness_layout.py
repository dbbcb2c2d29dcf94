"""Storage of the stiffness of a body: a band, or a sparse matrix where that would be large."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.matrices.band_matrix import BandLayout
from surrogate.mechanics.matrices.sparse_matrix import SparseLayout

MOST = 2**27  # entries of a band: 1 GB
Layout: TypeAlias = BandLayout | SparseLayout


def stiffness_layout(
    coordinates: NDArray[np.float64], cells: NDArray[np.int64], held: NDArray[np.bool_]
) -> Layout:
    """Choose the layout of the matrices of a body.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    held : array of bool, (n_nodes, m)
        Components that are no degrees of freedom.
    """
    band = BandLayout(coordinates, cells, held)
    return band if band.entries <= MOST else SparseLayout.of(cells, held)
