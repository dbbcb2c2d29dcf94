"""Finite elements of a mesh, linear or quadratic: gradients of the shape functions, volumes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.reference_cells import (
    LINEAR,
    quadratic_quadrature,
    quadratic_shape_gradients,
    quadrature,
    shape_gradients,
)

Array = NDArray[np.float64]


def cell_gradients(
    coordinates: Array, cells: NDArray[np.int64], cell_type: str
) -> tuple[Array, Array]:
    """Gradients of the shape functions, and volumes, at the quadrature points of every cell.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        Meshio's name of the cells; that of quadratic ones if the nodes are all of their points.

    Returns
    -------
    gradients : array, (n_cells, n_points, n_corners, d)
        ∂N_b/∂x_j in 1/m.
    volumes : array, (n_cells, n_points)
        Quadrature weight times ``|det ∂x/∂ξ|``, in m³ (in the plane m², per m of thickness).
    """
    points, weights = (quadratic_quadrature if cell_type in LINEAR else quadrature)(cell_type)
    gradients, determinants = gradients_at(coordinates, cells, cell_type, points)
    return gradients, weights * np.abs(determinants)


def gradients_at(
    coordinates: Array, cells: NDArray[np.int64], cell_type: str, points: Array
) -> tuple[Array, Array]:
    """Gradients of the shape functions at points of the reference cell, (n_points, d).

    Returns
    -------
    gradients : array, (n_cells, n_points, n_corners, d)
        ∂N_b/∂x_j in 1/m.
    determinants : array, (n_cells, n_points)
        det ∂x/∂ξ.
    """
    slopes = quadratic_shape_gradients if cell_type in LINEAR else shape_gradients
    reference = slopes(cell_type, points)
    jacobians = np.einsum("cbi,qbj->cqij", coordinates[cells], reference)
    gradients = np.einsum("qbj,cqji->cqbi", reference, np.linalg.inv(jacobians))
    return gradients, np.linalg.det(jacobians)
