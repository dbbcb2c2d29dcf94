r"""Gradient of a finite-element field at the nodes: the mean over the cells that meet there.

.. math:: \frac{∂u_i}{∂x_j}(x_a) ≈
   \frac{1}{|C_a|} \sum_{c ∈ C_a} \sum_b \frac{∂N_b^c}{∂x_j}(x_a) \, u_{ib}

with the cells :math:`C_a` at node a and their shape functions :math:`N_b^c`; it is exact for linear
fields.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

from shared_schema.common.bodies.reference_cells import CORNERS
from surrogate.mechanics.solids.elements import gradients_at

Array = NDArray[np.float64]


def nodal_gradient(coordinates: Array, cells: NDArray[np.int64], cell_type: str) -> list[csr_array]:
    """Make the sparse operators of the d derivatives, each (n_nodes, n_nodes).

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        Meshio's name of the cells.
    """
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    gradients, _ = gradients_at(coordinates, cells, cell_type, corners)
    nodes = len(coordinates)
    share = 1 / np.maximum(np.bincount(cells.ravel(), minlength=nodes), 1)
    shape = gradients.shape[:-1]
    rows = np.broadcast_to(cells[:, :, None], shape).ravel()
    columns = np.broadcast_to(cells[:, None, :], shape).ravel()
    return [
        coo_array(
            (gradients[..., j].ravel() * share[rows], (rows, columns)), shape=(nodes, nodes)
        ).tocsr()
        for j in range(coordinates.shape[1])
    ]
