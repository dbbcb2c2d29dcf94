r"""Volumes of cells and what of them belongs to each node, as a uniform body force needs them.

A force density b, in N per m³ of the undeformed body, has the consistent nodal forces

.. math:: f_a = b \int_{Ω} N_a \, dV

in N. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.reference_cells import CORNERS, GAUSS

Array = NDArray[np.float64]


def nodal_volumes(coordinates: Array, cells: NDArray[np.int64]) -> Array:
    """Integrate N_a over some cells for every node: (n_nodes,) in m³.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    """
    volumes = np.zeros(len(coordinates))
    np.add.at(volumes, cells, cell_shares(coordinates[cells]))
    return volumes


def cell_shares(corners: Array) -> Array:
    """Integrate N_a over each cell, for each of its corners.

    Parameters
    ----------
    corners : array, (n_cells, n_corners, d)
        Corner positions in m, VTK order.

    Returns
    -------
    array, (n_cells, n_corners)
        In m³; cells in the plane are 1 m thick.
    """
    count, d = corners.shape[1:]
    if count == d + 1:
        volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / factorial(d)
        return np.repeat(volume[:, None] / count, count, axis=1)
    signs = 2 * np.array(CORNERS["quad" if d == 2 else "hexahedron"]) - 1
    shares = np.zeros(corners.shape[:2])
    for point in product(GAUSS, repeat=d):
        factors = (1 + signs * np.array(point)) / 2
        slopes = [signs[:, j] / 2 * np.delete(factors, j, axis=1).prod(axis=1) for j in range(d)]
        jacobians = np.einsum("cai,ja->cij", corners, np.array(slopes))
        shares += np.abs(np.linalg.det(jacobians))[:, None] * factors.prod(axis=1)
    return shares
