"""Embed a structured grid on any mesh (the remark of Deshpande et al. 2022 on such meshes).

The grid spans the mesh's bounding box. The value at a grid point inside the body is that of the
finite-element field. The value at a grid point outside, if a node of the mesh depends on it, is
that of the nearest element's field, continued linearly. Both operators reproduce linear fields
exactly.
"""

from __future__ import annotations

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from datagen.mesh.distributed_mesh import UFL_NAMES
from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE

Array = NDArray[np.float64]

CANDIDATES = 24  # elements looked at for each grid point, those with the nearest centres
NEWTON_STEPS = 8  # of the search for reference coordinates; simplices need one
ROUNDING = 1e-9


def embed(
    coordinates: Array,
    cells: NDArray[np.int64],
    cell_type: str,
    shape: tuple[int, ...] | None = None,
) -> Grid:
    """Embed a grid on a mesh.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        VTK order.
    cell_type : str
        meshio's name.
    shape : tuple of d ints, optional
        Number of grid points along each axis, at least 2; by default after the elements' size.
    """
    lower, extent = coordinates.min(axis=0), np.ptp(coordinates, axis=0)
    if shape is None:
        spacing = element_size(coordinates, cells)
        shape = tuple(max(2, round(float(length / spacing)) + 1) for length in extent)
    step = extent / (np.asarray(shape) - 1)
    points, point_weights = multilinear((coordinates - lower) / step, shape)
    index = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=-1)
    cell, weights, outside = locate(lower + index * step, coordinates, cells, cell_type)
    used = np.zeros(len(index), dtype=bool)
    used[points[point_weights > 0]] = True
    has_value = used | (outside <= ROUNDING)
    sources = np.where(has_value[:, None], cells[cell], NO_NODE)
    source_weights = np.where(has_value[:, None], weights, 0.0)
    return Grid(
        sources.reshape(*shape, -1), source_weights.reshape(*shape, -1), points, point_weights
    )


def element_size(coordinates: Array, cells: NDArray[np.int64]) -> float:
    """Mean length of the elements' edges in m, over all pairs of neighbouring corners."""
    corners = coordinates[cells]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def multilinear(position: Array, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], Array]:
    """Interpolate multilinearly between the corners of the grid cells that hold some positions.

    Parameters
    ----------
    position : array, (n, d)
        Positions in units of the grid's steps.
    shape : tuple of d ints

    Returns
    -------
    points : array of int, (n, 2^d)
        Grid points, counted x slowest.
    weights : array, (n, 2^d)
    """
    nearest = np.round(position)
    position = np.where(np.abs(position - nearest) < ROUNDING, nearest, position)
    first = np.clip(np.floor(position).astype(np.int64), 0, np.asarray(shape) - 2)
    part = position - first
    points, weights = [], []
    for corner in np.ndindex(*(2,) * len(shape)):
        points.append(np.ravel_multi_index(tuple((first + corner).T), shape))
        weights.append(np.where(corner, part, 1 - part).prod(axis=1))
    return np.stack(points, axis=1), np.stack(weights, axis=1)


def locate(
    positions: Array, coordinates: Array, cells: NDArray[np.int64], cell_type: str
) -> tuple[NDArray[np.intp], Array, Array]:
    """Find the element that each position lies in or is nearest to, and its interpolation there.

    Parameters
    ----------
    positions : array, (n, d)
        In m.
    coordinates, cells, cell_type
        The mesh.

    Returns
    -------
    cell : array of int, (n,)
    weights : array, (n, n_corners)
        Weights of the element's nodes; outside of it those of the linear continuation.
    outside : array, (n,)
        Distance outside of the element, relative to its size; 0 inside.
    """
    corners = coordinates[cells]
    size = np.ptp(corners, axis=1).max(axis=1)
    tree = cKDTree(corners.mean(axis=1))
    count = min(CANDIDATES, len(cells))
    candidates = np.asarray(tree.query(positions, k=count)[1]).reshape(len(positions), count)
    best = np.full(len(positions), np.inf)
    cell = np.zeros(len(positions), dtype=np.intp)
    weights = np.zeros((len(positions), cells.shape[1]))
    outside = np.zeros(len(positions))
    for candidate in candidates.T:
        here, part = interpolation(positions, corners[candidate], cell_type)
        better = part * size[candidate] < best
        best[better] = (part * size[candidate])[better]
        cell[better], weights[better] = candidate[better], here[better]
        outside[better] = part[better]
    return cell, weights, outside


def interpolation(positions: Array, corners: Array, cell_type: str) -> tuple[Array, Array]:
    """Weights of an element's nodes at a position, continued linearly outside.

    The reference coordinates ξ solve x(ξ) = Σ N_a(ξ) x_a = x. Outside, the weights are those at
    the nearest ξ* of the element and of the gradient there, N(ξ*) + ∇N(ξ*) · (x − x(ξ*)).

    Parameters
    ----------
    positions : array, (n, d)
        In m.
    corners : array, (n, n_corners, d)
        Corners of one element for each position, in m.

    Returns
    -------
    weights : array, (n, n_corners)
    outside : array, (n,)
        Largest reference coordinate outside of the element; 0 inside.
    """
    is_simplex = cell_type in ("triangle", "tetra")
    xi = np.full(positions.shape, 0.25 if is_simplex else 0.5)
    for _ in range(1 if is_simplex else NEWTON_STEPS):
        value, gradient = shape_functions(xi, cell_type)
        jacobian = np.einsum("nca,ncb->nab", corners, gradient)
        residual = positions - np.einsum("nc,ncd->nd", value, corners)
        xi = xi + np.linalg.solve(jacobian, residual[..., None])[..., 0]
        if not is_simplex:
            xi = np.clip(xi, -1.0, 2.0)
    if is_simplex:
        outside = np.maximum(-xi.min(axis=1), xi.sum(axis=1) - 1)
    else:
        outside = np.abs(xi - 0.5).max(axis=1) - 0.5
        xi = np.clip(xi, 0.0, 1.0)
    value, gradient = shape_functions(xi, cell_type)
    jacobian = np.einsum("nca,ncb->nab", corners, gradient)
    rest = positions - np.einsum("nc,ncd->nd", value, corners)
    step = np.linalg.solve(jacobian, rest[..., None])[..., 0]
    return value + np.einsum("nca,na->nc", gradient, step), np.maximum(outside, 0.0)


def shape_functions(xi: Array, cell_type: str) -> tuple[Array, Array]:
    """N_a(ξ), (n, n_corners), and ∂N_a/∂ξ, (n, n_corners, d), corners in VTK order."""
    name = UFL_NAMES[cell_type]
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType.__members__[name], 1, basix.LagrangeVariant.equispaced
    )
    table = element.tabulate(1, np.ascontiguousarray(xi))[:, :, :, 0]
    kind = dolfinx.cpp.mesh.to_type(name)
    table = table[:, :, np.argsort(dolfinx.cpp.io.perm_vtk(kind, table.shape[2]))]
    return table[0], np.moveaxis(table[1:], 0, -1)
