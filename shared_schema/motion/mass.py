r"""Masses of the finite elements: consistent and lumped.

The mass matrix is the same for each component of the displacement,

.. math:: M_{ab} = \int_Ω ρ N_a N_b \, dV \qquad \text{in kg},

with the density ρ of the undeformed body, constant in each cell, and the shape functions N_a of
`shared_schema.common.bodies.reference_cells`. Cells have straight edges, so that their positions
are those of linear shape functions. Four Gauss points along each axis integrate all products
exactly; on triangles and tetrahedra the axes are those of

.. math:: ξ_1 = s_1, \quad ξ_2 = s_2 (1 - s_1), \quad ξ_3 = s_3 (1 - s_1) (1 - s_2), \qquad
          dV = (1 - s_1)^{d-1} (1 - s_2)^{d-2} \, ds .

A lumped mass is diagonal. It keeps the mass of each cell: of linear elements the sums of the rows,
of quadratic ones, whose sums may be negative, the diagonal of M scaled to the mass (Hinton, Rock
and Zienkiewicz 1976). In the plane a body is 1 m thick.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.bodies.points_between import PointsBetween
from shared_schema.common.bodies.reference_cells import (
    CORNERS,
    LINEAR,
    NAMES,
    quadratic_shape_values,
    shape_gradients,
    shape_values,
)
from shared_schema.common.errors import InputError
from shared_schema.materials import Materials, as_tuple

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
GAUSS_POINTS = 4


def _exact_quadrature(cell_type: str) -> tuple[Array, Array]:
    """Points (n, d) and weights (n,) of a reference cell with straight edges."""
    corners = np.array(CORNERS[cell_type])
    count, d = corners.shape
    at, of = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    s = np.array(list(product(0.5 + 0.5 * at, repeat=d)))
    weights = np.array(list(product(0.5 * of, repeat=d))).prod(axis=1)
    if count != d + 1:
        return s, weights
    points, left = np.empty_like(s), np.ones(len(s))
    for j in range(d):
        points[:, j] = s[:, j] * left
        weights = weights * left  # the Jacobian ∂ξ_j/∂s_j
        left = left * (1 - s[:, j])
    return points, weights


def mass_blocks(cell_type: str, corners: Array, density: Array, lumped: bool = False) -> Array:
    """Mass matrix of every cell, for one component of the displacement.

    Parameters
    ----------
    cell_type : str
        Meshio's name: triangle, quad, tetra or hexahedron, or one of the quadratic
        `reference_cells.NAMES`.
    corners : array, (n_cells, n_corners, d)
        Positions in m of the corners of the undeformed cells.
    density : array, (n_cells,)
        ρ in kg/m³.
    lumped : bool
        Diagonal matrices.

    Returns
    -------
    array, (n_cells, n_points, n_points)
        In kg; points in the order of the reference cell.
    """
    linear = LINEAR.get(cell_type, cell_type)
    points, weights = _exact_quadrature(linear)
    own = quadratic_shape_values if cell_type in LINEAR else shape_values
    values = own(cell_type, points)
    slopes = shape_gradients(linear, points)
    volume = np.empty((len(corners), len(points)))
    for number, slope in enumerate(slopes):
        volume[:, number] = np.abs(np.linalg.det(np.swapaxes(corners, 1, 2) @ slope))
    volume *= weights * density[:, None]
    blocks = np.einsum("cq,qa,qb->cab", volume, values, values, optimize=True)
    if not lumped:
        return np.asarray(blocks)
    if cell_type in LINEAR:
        diagonal = np.einsum("caa->ca", blocks)
        diagonal = diagonal * (volume.sum(axis=1) / diagonal.sum(axis=1))[:, None]
    else:
        diagonal = blocks.sum(axis=2)
    return np.asarray(diagonal[:, :, None] * np.eye(values.shape[1]))


def mass_matrix(
    coordinates: Array,
    cells: Numbers,
    cell_type: str,
    density: Array,
    points: PointsBetween | None = None,
    lumped: bool = False,
) -> csr_array:
    """Mass matrix of a body for one component of the displacement, (n_points, n_points) in kg.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    cell_type : str
        Meshio's name of the cells, triangle, quad, tetra or hexahedron.
    density : array, (n_cells,)
        ρ in kg/m³.
    points : PointsBetween, optional
        Points of quadratic elements; without them elements are linear.
    lumped : bool
        A diagonal matrix.
    """
    name, at = (cell_type, cells) if points is None else (NAMES[cell_type], points.cells)
    blocks = mass_blocks(name, coordinates[cells], density, lumped)
    count, width = len(coordinates) if points is None else points.count, at.shape[1]
    rows, columns = np.repeat(at, width, axis=1), np.tile(at, (1, width))
    triple = blocks.ravel(), (rows.ravel(), columns.ravel())
    matrix = csr_array(triple, shape=(count, count))
    matrix.sum_duplicates()
    if lumped:
        matrix.eliminate_zeros()
    return matrix


def densities_of_cells(materials: Materials, parts: Numbers | None, count: int) -> Array:
    """Density of every cell in kg/m³, (n_cells,), by the material of each.

    Raises
    ------
    InputError
        If a material has none.
    """
    several = as_tuple(materials)
    found = [each.density for each in several]
    for number, density in enumerate(found):
        if density is None:
            key = "material.density" if len(several) == 1 else f"material.{number}.density"
            raise InputError(f"key '{key}': missing, expected kg/m³: motion needs masses")
    values = np.array(found, dtype=np.float64)
    return values[np.zeros(count, dtype=np.int64) if parts is None else parts]
