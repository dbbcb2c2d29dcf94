r"""Gradient of a finite-element field at the nodes: the mean over the cells that meet there.

.. math:: \frac{∂u_i}{∂x_j}(x_a) ≈
   \frac{1}{|C_a|} \sum_{c ∈ C_a} \sum_b \frac{∂N_b^c}{∂x_j}(x_a) \, u_{ib}

with the cells :math:`C_a` at node a and their shape functions :math:`N_b^c`; it is exact for linear
fields.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

Array = NDArray[np.float64]
CORNERS = {  # of the reference cells, in VTK order
    "triangle": ((0, 0), (1, 0), (0, 1)),
    "quad": ((0, 0), (1, 0), (1, 1), (0, 1)),
    "tetra": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "hexahedron": (
        *((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
        *((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ),
}


def reference_gradients(cell_type: str) -> Array:
    """Derivatives of the shape functions at the corners of the reference cell.

    Returns
    -------
    array, (n_corners, n_corners, d)
        Derivative of the shape function of corner b (second axis) at corner a (first axis).
    """
    corners = np.array(CORNERS[cell_type], dtype=np.float64)
    count, dimension = corners.shape
    if count == dimension + 1:  # simplices: constant
        return np.broadcast_to(
            np.concatenate([-np.ones((1, dimension)), np.eye(dimension)]), (count, count, dimension)
        ).copy()
    gradients = np.empty((count, count, dimension))
    for (a, at), (b, of) in product(enumerate(corners), enumerate(corners)):
        factors = np.where(of == 1, at, 1 - at)  # N_b is the product of these
        slopes = np.where(of == 1, 1.0, -1.0)
        for j in range(dimension):
            gradients[a, b, j] = slopes[j] * np.delete(factors, j).prod()
    return gradients


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
    reference = reference_gradients(cell_type)
    jacobians = np.einsum("cbi,abj->caij", coordinates[cells], reference)
    gradients = np.einsum("abj,caji->cabi", reference, np.linalg.inv(jacobians))
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
