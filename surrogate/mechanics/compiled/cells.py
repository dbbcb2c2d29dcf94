"""Gradients and forces in the cells of a body, in loops that Numba compiles.

Cells come in blocks; a field at one quadrature point of every cell of a block is a row. So loops
over a row are long, whatever the element, and what they read stays in the cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.compiled.fields import Array, inner

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
    numbers : array of int, (n_blocks, n)
        Of the cells; −1 at the end of a block that is filled up.
    order : array of int, (n_blocks, n)
        The same; of a small body, whose points are cells, the numbers of the points.
    """

    nodes: NDArray[np.int64]
    gradients: Array
    volumes: Array
    unit: float
    laws: NDArray[np.int64]
    numbers: NDArray[np.int64]
    order: NDArray[np.int64]

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
        of_cells = np.zeros(count, np.int64) if materials is None else materials
        numbers, slopes = np.arange(count), gradients.swapaxes(1, 2)
        if count * points <= ROW:  # of a small body, every point is a cell
            slopes = slopes.reshape(-1, 1, corners, d)
            volumes = volumes.reshape(-1, 1)
            of_cells, numbers = of_cells.repeat(points), numbers.repeat(points)
        kinds = np.unique(of_cells)
        members = [np.flatnonzero(of_cells == kind) for kind in kinds]
        shapes = [_shape(len(some)) for some in members]
        row = max(shape[1] for shape in shapes)
        order = np.concatenate(
            [_filled(some, shape, row) for some, shape in zip(members, shapes, strict=True)]
        )
        laws = np.concatenate(
            [np.full(shape[0], kind) for shape, kind in zip(shapes, kinds, strict=True)]
        )
        edge = (0, 0), (0, 0), (0, -corners % CORNERS), (0, 0)
        weights = _by_row(volumes, order)
        return cls(
            _by_row(np.pad(cells[numbers], edge[1:3]), order),
            _by_row(np.pad(slopes, edge), order),
            weights.reshape(-1, weights.shape[-1]),
            unit,
            laws,
            np.where(order < 0, -1, numbers[order]),
            order,
        )

    @property
    def row(self) -> int:
        """Cells of a block, with those that fill it up."""
        return self.numbers.shape[1]

    def of_points(self, values: Array) -> Array:
        """Values at the points of all cells in rows: (n_cells, n_points, …) → (n_rows, …, n)."""
        points = self.gradients.shape[1]
        found = _by_row(values.reshape(-1, points, *values.shape[2:]), self.order)
        return found.reshape(-1, *found.shape[2:])

    def of_cells(self, values: Array) -> Array:
        """Values of all cells by blocks: (n_cells, …) → (n_blocks, …, n)."""
        return _by_row(values, self.numbers)


def _shape(count: int) -> tuple[int, int]:
    """Number of the blocks of so many cells, and of the cells in each."""
    blocks = -(-count // ROW)
    return blocks, -(-count // (blocks * ALIGNED)) * ALIGNED


def _filled(some: NDArray[np.int64], shape: tuple[int, int], row: int) -> NDArray[np.int64]:
    """Numbers in blocks of a length, filled up with −1."""
    found = np.full(shape[0] * shape[1], -1)
    found[: len(some)] = some
    return np.pad(found.reshape(shape), ((0, 0), (0, row - shape[1])), constant_values=-1)


def _by_row(values: Array, order: NDArray[np.int64]) -> Array:
    """Values of cells, (n_cells, …), as rows in an order (n_blocks, n): (n_blocks, …, n)."""
    found = values[order]
    found[order < 0] = 0
    return np.ascontiguousarray(np.moveaxis(found, 1, -1))


@inner
def at_corners(nodes: NDArray[np.int64], u: Array, out: Array) -> None:
    """Write values at the corners of a block: (n_nodes, d) → (n_corners, d, n)."""
    for a in range(len(nodes)):
        for c in range(nodes.shape[1]):
            for i in range(u.shape[1]):
                out[a, i, c] = u[nodes[a, c], i]


@inner
def add_at_nodes(nodes: NDArray[np.int64], values: Array, out: Array) -> None:
    """Add values of the corners of a block: (n_corners, d, n) → (n_nodes, d)."""
    for a in range(len(nodes)):
        for c in range(nodes.shape[1]):
            for i in range(out.shape[1]):
                out[nodes[a, c], i] += values[a, i, c]


@inner
def add_four(a: Array, b: Array, i: int, j: int, out: Array) -> None:
    """Add the products of four rows, [k, i] and [k, j] of (4, d, n) each, to a row."""
    a0, a1, a2, a3 = a[0, i], a[1, i], a[2, i], a[3, i]
    b0, b1, b2, b3 = b[0, j], b[1, j], b[2, j], b[3, j]
    for q in range(len(out)):
        out[q] += a0[q] * b0[q] + a1[q] * b1[q] + a2[q] * b2[q] + a3[q] * b3[q]


@inner
def slopes_of(gradients: Array, u: Array, out: Array) -> None:
    """Write the gradients at a point of every cell: (n_corners, d, n) twice → (d, d, n)."""
    corners, d, _ = gradients.shape
    for i in range(d):
        for j in range(d):
            out[i, j, :] = 0
            for a in range(0, corners, CORNERS):
                add_four(u[a : a + CORNERS], gradients[a : a + CORNERS], i, j, out[i, j])


@inner
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
