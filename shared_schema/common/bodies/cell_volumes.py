r"""Volumes of cells and what of them belongs to each point, as a uniform body force needs them.

A force density b, in N per m³ of the undeformed body, has the consistent forces

.. math:: f_a = b \int_{Ω} N_a \, dV

in N on the points of the cells: the corners and, on quadratic elements, those between them
(`shared_schema.common.bodies.quadratic`). In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.quadratic.quadratic_cells import (
    quadratic_quadrature,
    quadratic_shape_gradients,
    quadratic_shape_values,
)
from shared_schema.common.bodies.reference_cells import quadrature, shape_gradients, shape_values

Array = NDArray[np.float64]
SIMPLICES = {  # shares of a simplex with straight edges: of its corners, and of the edges' middles
    (2, 6): (0.0, 1 / 3),
    (3, 10): (-1 / 20, 1 / 5),
}
QUADRATIC = {(2, 9): "quad9", (3, 27): "hexahedron27"}  # by d, number of points


def nodal_volumes(coordinates: Array, cells: NDArray[np.int64]) -> Array:
    """Integrate N_a over some cells for every point: (n_points,) in m³.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Positions of the points of the body in m; all of them are nodes of linear elements.
    cells : array of int, (n_cells, n_points of a cell)
        Numbers of points, VTK order.
    """
    volumes = np.zeros(len(coordinates))
    np.add.at(volumes, cells, cell_shares(coordinates[cells]))
    return volumes


def cell_shares(points: Array) -> Array:
    """Integrate N_a over each cell, for each of its points.

    Parameters
    ----------
    points : array, (n_cells, n_points, d)
        Positions of the points of the cells in m, VTK order. Cells have straight edges.

    Returns
    -------
    array, (n_cells, n_points)
        In m³; cells in the plane are 1 m thick.
    """
    count, d = points.shape[1:]
    if count == d + 1 or (d, count) in SIMPLICES:
        volume = np.abs(np.linalg.det(points[:, 1 : d + 1] - points[:, :1])) / factorial(d)
        of_corners, of_edges = SIMPLICES.get((d, count), (1 / (d + 1), 0.0))
        return np.outer(volume, np.where(np.arange(count) <= d, of_corners, of_edges))
    if (d, count) in QUADRATIC:
        cell = QUADRATIC[d, count]
        at, weights = quadratic_quadrature(cell)
        values, slopes = quadratic_shape_values(cell, at), quadratic_shape_gradients(cell, at)
    else:
        cell = "quad" if d == 2 else "hexahedron"
        at, weights = quadrature(cell)
        values, slopes = shape_values(cell, at), shape_gradients(cell, at)
    jacobians = np.einsum("cai,qaj->cqij", points, slopes)
    return np.asarray(np.abs(np.linalg.det(jacobians)) * weights @ values)
