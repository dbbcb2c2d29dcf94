"""Gradients and forces in the cells of a body, in loops that Numba compiles.

Cells come in blocks; a field at one quadrature point of every cell of a block is a row. So loops
over a row are long, whatever the element, and what they read stays in the cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.series.compiled_fields import Array, compiled

ROW = 256  # cells of a block, at most
ALIGNED = 8  # their number is a multiple
CORNERS = 4  # that are summed together


class Cells(NamedTuple):
    """Cells in blocks, filled up with cells whose gradients and volumes are zero.

    Attributes
    ----------
    nodes : array of int, (n_blocks, n_corners, n)
        The corners, filled up to a multiple of `CORNERS`.
    gradients : array, (n_blocks, n_points, n_corners, d, n)
        Of the shape functions in 1/m at the quadrature points of a cell.
    volumes : array, (n_blocks · n_points, n)
        Of the quadrature points, in rows.
    unit : float
        Of the volumes, in m³ (m² in the plane).
    laws : array of int, (n_blocks,)
        Number of the material of the cells of every block.
    """

    nodes: NDArray[np.int64]
    gradients: Array
    volumes: Array
    unit: float
    laws: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        cells: NDArray[np.int64],
        gradients: Array,
        volumes: Array,
        unit: float,
        materials: NDArray[np.int64] | None = None,
    ) -> Cells:
        """Arrange cells; those of a block are of one material.

        Parameters
        ----------
        cells : array of int, (n_cells, n_corners)
        gradients : array, (n_cells, n_corners, n_points, d)
        volumes : array, (n_cells, n_points)
        unit : float
            Of the volumes.
        materials : array of int, (n_cells,), optional
            Number of every cell's material; 0 by default.
        """
        count, corners, points, d = gradients.shape
        numbers = np.zeros(count, np.int64) if materials is None else materials
        if count * points <= ROW:  # of a small body, every point is a cell
            gradients = gradients.swapaxes(1, 2).reshape(-1, corners, 1, d)
            cells, volumes = cells.repeat(points, axis=0), volumes.reshape(-1, 1)
            numbers = numbers.repeat(points)
        kinds = np.unique(numbers)
        parts = [
            _blocks(cells[some], gradients[some], volumes[some])
            for some in (numbers == kind for kind in kinds)
        ]
        row = max(part[0].shape[-1] for part in parts)
        nodes, slopes, weights = (
            np.concatenate([_wider(part[field], row) for part in parts]) for field in range(3)
        )
        laws = np.concatenate(
            [np.full(len(part[0]), kind) for part, kind in zip(parts, kinds, strict=True)]
        )
        return cls(nodes, slopes, weights, unit, laws)


def _blocks(cells: NDArray[np.int64], gradients: Array, volumes: Array) -> tuple[Array, ...]:
    """Nodes, gradients and volumes of the cells of one material, in blocks."""
    count, corners, points, d = gradients.shape
    blocks = -(-count // ROW)
    row = -(-count // (blocks * ALIGNED)) * ALIGNED
    padded = corners + -corners % CORNERS
    nodes = np.zeros((blocks * row, padded), np.int64)
    nodes[:count, :corners] = cells
    slopes = np.zeros((blocks * row, points, padded, d), gradients.dtype)
    slopes[:count, :, :corners] = gradients.swapaxes(1, 2)
    weights = np.zeros((blocks * row, points), volumes.dtype)
    weights[:count] = volumes
    shape = blocks, row
    rows = _by_row(weights, shape).reshape(blocks * points, row)
    return _by_row(nodes, shape), _by_row(slopes, shape), rows


def _wider(rows: Array, width: int) -> Array:
    """Rows that are filled up with zeros."""
    return np.pad(rows, [*[(0, 0)] * (rows.ndim - 1), (0, width - rows.shape[-1])])


def _by_row(of_cells: Array, shape: tuple[int, int]) -> Array:
    """Values of cells, (n_blocks · n, …), as rows: (n_blocks, …, n)."""
    values = of_cells.reshape(*shape, *of_cells.shape[1:])
    return np.ascontiguousarray(np.moveaxis(values, 1, -1))


@compiled
def at_corners(nodes: NDArray[np.int64], u: Array, out: Array) -> None:
    """Write values at the corners of a block: (n_nodes, d) → (n_corners, d, n)."""
    for a in range(len(nodes)):
        for c in range(nodes.shape[1]):
            for i in range(u.shape[1]):
                out[a, i, c] = u[nodes[a, c], i]


@compiled
def add_at_nodes(nodes: NDArray[np.int64], values: Array, out: Array) -> None:
    """Add values of the corners of a block: (n_corners, d, n) → (n_nodes, d)."""
    for a in range(len(nodes)):
        for c in range(nodes.shape[1]):
            for i in range(out.shape[1]):
                out[nodes[a, c], i] += values[a, i, c]


@compiled
def add_four(a: Array, b: Array, i: int, j: int, out: Array) -> None:
    """Add the products of four rows, [k, i] and [k, j] of (4, d, n) each, to a row."""
    a0, a1, a2, a3 = a[0, i], a[1, i], a[2, i], a[3, i]
    b0, b1, b2, b3 = b[0, j], b[1, j], b[2, j], b[3, j]
    for q in range(len(out)):
        out[q] += a0[q] * b0[q] + a1[q] * b1[q] + a2[q] * b2[q] + a3[q] * b3[q]


@compiled
def slopes_of(gradients: Array, u: Array, out: Array) -> None:
    """Write the gradients at a point of every cell: (n_corners, d, n) twice → (d, d, n)."""
    corners, d, _ = gradients.shape
    for i in range(d):
        for j in range(d):
            out[i, j, :] = 0
            for a in range(0, corners, CORNERS):
                add_four(u[a : a + CORNERS], gradients[a : a + CORNERS], i, j, out[i, j])


@compiled
def add_forces(gradients: Array, stress: Array, out: Array) -> None:
    """Add forces of a weighted stress: (n_corners, d, n), (d, d, n) → (n_corners, d, n)."""
    corners, d, row = gradients.shape
    for a in range(corners):
        g0, g1 = gradients[a, 0], gradients[a, 1]
        for i in range(d):
            total, s0, s1 = out[a, i], stress[i, 0], stress[i, 1]
            if d == 3:
                g2, s2 = gradients[a, 2], stress[i, 2]
                for q in range(row):
                    total[q] += s0[q] * g0[q] + s1[q] * g1[q] + s2[q] * g2[q]
            else:
                for q in range(row):
                    total[q] += s0[q] * g0[q] + s1[q] * g1[q]
