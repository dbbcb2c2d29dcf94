"""Embed a structured grid on any mesh (the remark of Deshpande et al. 2022 on such meshes).

The grid spans the mesh's bounding box. The value at a grid point inside the body is that of the
finite-element field. The value at a grid point outside, if a node of the mesh depends on it, is
that of the nearest element's field, continued linearly. Both operators reproduce linear fields
exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE
from shared_schema.points_in_cells import ROUNDING, locate

Array = NDArray[np.float64]


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
