r"""A structured grid embedded on a mesh that has no structured order.

Displacements go to the grid by the finite elements' own interpolation, U = A u, and back to the
nodes by multilinear interpolation between grid points, u ≈ B U. Forces go to the grid by the
transpose, F = Bᵀ f, so that their work F·U = f·B U and their resultant are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.grid_map import NO_NODE


@dataclass(frozen=True)
class EmbeddedGrid:
    """The two maps, each as the few nodes or points, and their weights, that a value is made of.

    Attributes
    ----------
    sources : array of int, (nx, ny[, nz], n_sources)
        Nodes that the value at a grid point is made of, -1 where the grid has no value.
    source_weights : array, (nx, ny[, nz], n_sources)
        Rows of A; 0 where the grid has no value.
    points : array of int, (n_nodes, 2^d)
        Grid points, counted x slowest, that the value at a node is made of.
    point_weights : array, (n_nodes, 2^d)
        Rows of B.
    """

    sources: NDArray[np.int64]
    source_weights: NDArray[np.float64]
    points: NDArray[np.int64]
    point_weights: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, ...]:
        """(nx, ny[, nz])."""
        return tuple(self.sources.shape[:-1])

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Grid points that have a value, (nx, ny[, nz])."""
        return np.not_equal(self.sources[..., 0], NO_NODE)

    @property
    def nodes(self) -> int:
        """Number of nodes of the mesh."""
        return len(self.points)

    def to_grid(self, nodal: NDArray[Any]) -> NDArray[Any]:
        """Displacements U = A u: (..., n_nodes, d) → (..., d, nx, ny[, nz])."""
        values = np.swapaxes(nodal, -1, -2)
        columns = zip(_columns(self.sources), _columns(self.source_weights), strict=True)
        grid = sum(values[..., nodes] * weights for nodes, weights in columns)
        return np.asarray(grid, dtype=nodal.dtype).reshape(*values.shape[:-1], *self.shape)

    def forces_to_grid(self, nodal: NDArray[Any]) -> NDArray[Any]:
        """Forces F = Bᵀ f: (..., n_nodes, d) → (..., d, nx, ny[, nz])."""
        values = np.swapaxes(nodal, -1, -2)
        grid = np.zeros((*values.shape[:-1], int(np.prod(self.shape))))
        every: Any = ...
        for points, weights in zip(self.points.T, self.point_weights.T, strict=True):
            np.add.at(grid, (every, points), values * weights)
        return grid.astype(nodal.dtype).reshape(*values.shape[:-1], *self.shape)

    def to_nodes(self, grid: NDArray[Any]) -> NDArray[Any]:
        """Displacements u = B U: (..., d, nx, ny[, nz]) → (..., n_nodes, d)."""
        values = grid.reshape(*grid.shape[: -len(self.shape)], -1)
        columns = zip(self.points.T, self.point_weights.T, strict=True)
        nodal = sum(values[..., points] * weights for points, weights in columns)
        return np.ascontiguousarray(np.swapaxes(np.asarray(nodal, dtype=grid.dtype), -1, -2))

    def moved_by(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Grid points whose value depends on that of a chosen node: (n_nodes,) → (nx, ny[, nz])."""
        takes_part = chosen[self.sources] & (self.source_weights != 0)
        return np.asarray(takes_part.any(axis=-1))


def _columns(values: NDArray[Any]) -> NDArray[Any]:
    """Row by row over the grid to column by column: (nx, ny[, nz], n) → (n, nx·ny[·nz])."""
    return values.reshape(-1, values.shape[-1]).T
