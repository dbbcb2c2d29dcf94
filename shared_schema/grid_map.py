"""The map between nodes and a structured grid, zero where the grid has no node.

Grid order: x slowest, then y, then z, lower corner first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

NO_NODE = -1


@dataclass(frozen=True)
class GridMap:
    """Which node stands at which grid point.

    Attributes
    ----------
    node_at : array of int, (nx, ny[, nz])
        Node number at each grid point, -1 where there is none; every node stands exactly once.
    """

    node_at: NDArray[np.int64]

    @classmethod
    def from_coordinates(cls, coordinates: NDArray[np.float64]) -> GridMap:
        """Find the grid of an axis-parallel structured mesh from its node coordinates.

        The grid lines are the distinct coordinates along each axis; the body may leave grid
        points empty, as an L-shape does.

        Parameters
        ----------
        coordinates : array, (n_nodes, d)
            In m.

        Raises
        ------
        ValueError
            If two nodes share a grid point, or fewer than a quarter of the grid points are nodes,
            so that the mesh has no structured order.
        """
        size = float(np.ptp(coordinates, axis=0).max())
        position = []
        for values in coordinates.T:
            order = np.argsort(values, kind="stable")
            is_new_line = np.diff(values[order], prepend=values[order][0]) > 1e-6 * size
            line = np.empty(len(values), dtype=np.int64)
            line[order] = np.cumsum(is_new_line)
            position.append(line)
        shape = tuple(int(line.max()) + 1 for line in position)
        if np.prod(shape) > 4 * len(coordinates):
            raise ValueError(
                f"{len(coordinates)} nodes on a grid of {shape}: the mesh has no structured order"
            )
        node_at = np.full(shape, NO_NODE, dtype=np.int64)
        node_at[tuple(position)] = np.arange(len(coordinates))
        if np.count_nonzero(node_at != NO_NODE) != len(coordinates):
            raise ValueError("two nodes stand at the same grid point")
        return cls(node_at)

    def reordered(self, nodes: NDArray[np.int64]) -> GridMap:
        """The same grid points with other nodes on them: `nodes` in the order of the grid points.

        Parameters
        ----------
        nodes : array of int, (n_nodes,)
            Every node number once.
        """
        node_at = self.node_at.copy()
        node_at[self.mask] = nodes
        return GridMap(node_at)

    @property
    def shape(self) -> tuple[int, ...]:
        """(nx, ny[, nz])."""
        return tuple(self.node_at.shape)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Grid points that are nodes, (nx, ny[, nz])."""
        return np.not_equal(self.node_at, NO_NODE)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return int(np.count_nonzero(self.mask))

    def to_grid(self, nodal: NDArray[Any]) -> NDArray[Any]:
        """Lay nodal vectors on the grid: (..., n_nodes, d) → (..., d, nx, ny[, nz])."""
        *lead, _, components = nodal.shape
        grid = np.zeros((*lead, components, *self.shape), dtype=nodal.dtype)
        grid[..., self.mask] = np.swapaxes(nodal, -1, -2)[..., self.node_at[self.mask]]
        return grid

    def forces_to_grid(self, nodal: NDArray[Any]) -> NDArray[Any]:
        """Lay nodal forces on the grid, as any nodal vectors."""
        return self.to_grid(nodal)

    def moved_by(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Grid points on which chosen nodes stand: (n_nodes,) → (nx, ny[, nz])."""
        return self.mask & chosen[self.node_at]

    def to_nodes(self, grid: NDArray[Any]) -> NDArray[Any]:
        """Take nodal vectors from the grid: (..., d, nx, ny[, nz]) → (..., n_nodes, d)."""
        values = grid[..., self.mask]
        nodal = np.empty_like(values)
        nodal[..., self.node_at[self.mask]] = values
        return np.ascontiguousarray(np.swapaxes(nodal, -1, -2))
