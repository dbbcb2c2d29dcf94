"""Embed a structured grid on any mesh, as fine as the error of displacements on it asks for.

Deshpande et al. 2022 remark on such meshes. The grid spans the mesh's bounding box. The value at a
grid point inside the body is that of the finite-element field. The value at a grid point outside,
if a node of the mesh depends on it, is that of the nearest element's field, continued linearly.
Both operators reproduce linear fields exactly.
"""

from __future__ import annotations

import logging
import math

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory
from shared_schema.dataset_reader import DatasetReader
from shared_schema.grid import Grid
from shared_schema.layout import NO_NODE
from shared_schema.points_in_cells import ROUNDING, locate

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)
FINER = 1.25  # ratio of the steps of a grid and of the next finer one
FEW = 100  # samples, evenly spaced, that a grid is tried with before all are
MOST = 64  # grid points for each node of the mesh


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


def mesh_of(reader: DatasetReader) -> RawMesh:
    """Mesh of a dataset."""
    return RawMesh(reader.body["mesh/coordinates"], reader.body["mesh/cells"], reader.cell_type)


def embedded(reader: DatasetReader, shape: tuple[int, ...] | None = None) -> Grid:
    """Embed a grid on the mesh of a dataset, by default as fine as the mesh."""
    mesh = mesh_of(reader)
    return embed(mesh.coordinates, mesh.cells, mesh.cell_type, shape)


def embedded_within(reader: DatasetReader, error: float) -> Grid:
    """Embed the coarsest grid whose own error on the samples of a dataset is within a bound.

    The first is as fine as the mesh; each further one has 1.25 times the points along every axis.

    Parameters
    ----------
    reader : DatasetReader
        Nodal dataset.
    error : float
        Largest mean over the samples of ‖u_grid→nodes − u‖₂ / ‖u‖₂.

    Raises
    ------
    InputError
        If the bound needs a grid of more than 64 points for each node, or one
        that does not fit the memory.
    """
    grid, few = embedded(reader), some_displacements(reader)
    while True:
        found = round_trip_errors(grid, few).mean()
        if found <= error:
            found = error_of(reader, grid)
            if found <= error:
                return grid
        shape = finer(grid.shape)
        if math.prod(shape) > MOST * grid.nodes:
            text = " x ".join(str(count) for count in grid.shape)
            raise InputError(
                f"--error {error:g}: a {text} grid, {MOST} points for each node at most, still has "
                f"{found:.2g}; expected a larger one, or a finer mesh"
            )
        require_grid_memory(shape, reader, f"--error {error:g}")
        grid = embedded(reader, shape)


def log_finer(reader: DatasetReader, grid: Grid) -> None:
    """Log what the next finer grid would give, on some samples."""
    shape, few = finer(grid.shape), some_displacements(reader)
    other = round_trip_errors(embedded(reader, shape), few).mean()
    text = " x ".join(str(count) for count in shape)
    given = ",".join(str(count) for count in shape)
    logger.info(
        "displacements to a %s grid and back would differ by %.2f%% in the mean (--grid %s); "
        "--error takes a grid by its error",
        *(text, 100 * other, given),
    )


def finer(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Numbers of points of the next finer grid."""
    return tuple(max(count + 1, round(FINER * (count - 1)) + 1) for count in shape)


def error_of(reader: DatasetReader, grid: Grid) -> float:
    """Mean over all samples of the error of displacements taken to a grid and back."""
    parts = [round_trip_errors(grid, nodal["samples/displacement"]) for _, nodal in reader]
    return float(np.concatenate(parts).mean())


def some_displacements(reader: DatasetReader) -> Array:
    """Displacements in m of some samples, evenly spaced: (N, n_nodes, d)."""
    every, start, parts = -(-reader.manifest.samples // FEW), 0, []
    for entry, nodal in reader:
        parts.append(nodal["samples/displacement"][-start % every :: every])
        start += entry.samples
    return np.concatenate(parts)


def round_trip_errors(grid: Grid, displacement: Array) -> Array:
    """‖u_grid→nodes − u‖₂ / ‖u‖₂ of every sample: (N, n_nodes, d) → (N,)."""
    back = grid.to_nodes(grid.to_grid(displacement))
    size = np.linalg.norm(displacement, axis=(1, 2))
    return np.linalg.norm(back - displacement, axis=(1, 2)) / np.where(size > 0, size, 1.0)


def require_grid_memory(shape: tuple[int, ...], reader: DatasetReader, key: str) -> None:
    """Raise InputError, beginning with the option, unless an embedded grid fits the memory."""
    corners = reader.body["mesh/cells"].shape[1]
    samples = max(entry.samples for entry in reader.manifest.shards)
    numbers = 4 * corners + 4 * reader.manifest.dimension * samples  # both operators, both fields
    require_memory(8.0 * numbers * math.prod(shape), key)
