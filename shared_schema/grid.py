r"""The structured grid of a mesh: two sparse operators between its nodes and the grid points.

.. math:: U = A u, \qquad u = B U, \qquad F = B^T f

A takes nodal displacements to the grid, B takes them back to the nodes, and :math:`B^T` takes nodal
forces to the grid, which keeps their work :math:`F·U = f·B U` and their resultant. On a mesh that
has a structured order every node is a grid point, and both operators are (partial) permutations. On
any other mesh A is the finite elements' own interpolation and B is multilinear between grid points.

Grid order: x slowest, then y, then z, lower corner first.

A shard holds a grid whose points are the nodes as ``grid/node_at``, and an embedded one as both
operators: ``grid/sources`` with ``grid/source_weights``, ``grid/points`` with
``grid/point_weights``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import hold_read_only
from shared_schema.layout import NO_NODE, Arrays

IN_A_ROW = "nodes"  # the name of such a grid, where a grid is chosen


@dataclass(frozen=True)
class Grid:
    """The operators A and B row by row: the columns that are not zero, and the weights there.

    Its arrays are read-only.

    Attributes
    ----------
    sources : array of int, (nx, ny[, nz], n_sources)
        Columns of A: nodes that the value at a grid point is made of, -1 where it has no value.
    source_weights : array, (nx, ny[, nz], n_sources)
        Weights of A; 0 where the grid has no value.
    points : array of int, (n_nodes, n_points)
        Columns of B: grid points, counted x slowest, that the value at a node is made of.
    point_weights : array, (n_nodes, n_points)
        Weights of B.
    """

    sources: NDArray[np.int64]
    source_weights: NDArray[np.float64]
    points: NDArray[np.int64]
    point_weights: NDArray[np.float64]

    def __post_init__(self) -> None:
        hold_read_only(self)

    @classmethod
    def of_nodes(cls, node_at: NDArray[np.int64]) -> Grid:
        """Make the grid whose points are the nodes.

        Parameters
        ----------
        node_at : array of int, (nx, ny[, nz])
            Node number at each grid point, -1 where there is none.

        Raises
        ------
        ValueError
            If the nodes 0 … n − 1 do not stand exactly once each.
        """
        has_node = np.not_equal(node_at, NO_NODE)
        numbers = node_at[has_node]
        if not np.array_equal(np.sort(numbers), np.arange(numbers.size)):
            raise ValueError("expected every node exactly once on the grid")
        points = np.empty((numbers.size, 1), dtype=np.int64)
        points[numbers, 0] = np.flatnonzero(has_node)
        weights = has_node.astype(np.float64)
        return cls(node_at[..., None], weights[..., None], points, np.ones(points.shape))

    @classmethod
    def in_a_row(cls, nodes: int, dimension: int) -> Grid:
        """Make the grid on which all nodes stand in a row along x, of a mesh without order."""
        return cls.of_nodes(np.arange(nodes).reshape(nodes, *(1,) * (dimension - 1)))

    @classmethod
    def from_coordinates(cls, coordinates: NDArray[np.float64]) -> Grid:
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
        return cls.of_nodes(node_at)

    def reordered(self, nodes: NDArray[np.int64]) -> Grid:
        """Put other nodes on the grid points of an exact grid.

        Parameters
        ----------
        nodes : array of int, (n_nodes,)
            Every node number once, in the order of the grid points.
        """
        node_at = self.node_at.copy()
        node_at[self.mask] = nodes
        return Grid.of_nodes(node_at)

    @cached_property
    def points_are_nodes(self) -> bool:
        """True if the grid is exact: every node is a grid point, A and B are permutations."""
        if self.sources.shape[-1] != 1 or self.points.shape[-1] != 1:
            return False
        at, weights = self.sources[..., 0], self.source_weights[..., 0]
        return bool(
            np.all(self.point_weights == 1)
            and np.array_equal(weights, self.mask)
            and np.count_nonzero(self.mask) == self.nodes
            and np.array_equal(at.ravel()[self.points[:, 0]], np.arange(self.nodes))
        )

    @property
    def is_a_row(self) -> bool:
        """True if neighbours on the grid are none in space, since all nodes stand in a row."""
        return self.points_are_nodes and max(self.shape[1:]) == 1

    @property
    def node_at(self) -> NDArray[np.int64]:
        """Node number at each point of an exact grid, -1 where there is none: (nx, ny[, nz])."""
        if not self.points_are_nodes:
            raise ValueError("the points of an embedded grid are no nodes")
        return self.sources[..., 0]

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
        """Take displacements to the grid, U = A u: (..., n_nodes, d) → (..., d, nx, ny[, nz])."""
        values = np.swapaxes(nodal, -1, -2)
        if self.points_are_nodes:
            grid = np.zeros((*values.shape[:-1], *self.shape), dtype=nodal.dtype)
            grid[..., self.mask] = values[..., self.sources[self.mask, 0]]
            return grid
        columns = zip(_columns(self.sources), _columns(self.source_weights), strict=True)
        sums = sum(values[..., nodes] * weights for nodes, weights in columns)
        return np.asarray(sums, dtype=nodal.dtype).reshape(*values.shape[:-1], *self.shape)

    def forces_to_grid(self, nodal: NDArray[Any]) -> NDArray[Any]:
        """Take forces to the grid, F = Bᵀ f: (..., n_nodes, d) → (..., d, nx, ny[, nz])."""
        if self.points_are_nodes:
            return self.to_grid(nodal)
        loaded = np.flatnonzero(nodal.any(axis=-1).reshape(-1, self.nodes).any(axis=0))
        values = np.swapaxes(nodal[..., loaded, :], -1, -2)
        grid = np.zeros((*values.shape[:-1], int(np.prod(self.shape))))
        every: Any = ...
        columns = zip(self.points[loaded].T, self.point_weights[loaded].T, strict=True)
        for points, weights in columns:
            np.add.at(grid, (every, points), values * weights)
        return grid.astype(nodal.dtype).reshape(*values.shape[:-1], *self.shape)

    def to_nodes(self, grid: NDArray[Any]) -> NDArray[Any]:
        """Take displacements to the nodes, u = B U: (..., d, nx, ny[, nz]) → (..., n_nodes, d)."""
        values = grid.reshape(*grid.shape[: -len(self.shape)], int(np.prod(self.shape)))
        if self.points_are_nodes:
            nodal = values[..., self.points[:, 0]]
        else:
            columns = zip(self.points.T, self.point_weights.T, strict=True)
            sums = sum(values[..., points] * weights for points, weights in columns)
            nodal = np.asarray(sums, dtype=grid.dtype)
        return np.ascontiguousarray(np.swapaxes(nodal, -1, -2))

    def moved_by(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Grid points whose value depends on that of a chosen node: (n_nodes,) → (nx, ny[, nz])."""
        takes_part = chosen[self.sources] & (self.source_weights != 0)
        return np.asarray(takes_part.any(axis=-1))


def _columns(values: NDArray[Any]) -> NDArray[Any]:
    """Turn rows over the grid into columns: (nx, ny[, nz], n) → (n, nx·ny[·nz])."""
    return values.reshape(-1, values.shape[-1]).T


def grid_arrays(grid: Grid) -> Arrays:
    """Arrays of a grid, by the schema's paths of a structured shard."""
    if grid.points_are_nodes:
        return {"grid/node_at": grid.node_at, "grid/mask": grid.mask}
    return {
        "grid/sources": grid.sources,
        "grid/source_weights": grid.source_weights,
        "grid/points": grid.points,
        "grid/point_weights": grid.point_weights,
        "grid/mask": grid.mask,
    }


def grid_of(arrays: Arrays) -> Grid:
    """Make the grid that has these arrays (`grid_arrays`)."""
    if "grid/node_at" in arrays:
        return Grid.of_nodes(arrays["grid/node_at"])
    return Grid(
        arrays["grid/sources"],
        arrays["grid/source_weights"],
        arrays["grid/points"],
        arrays["grid/point_weights"],
    )
