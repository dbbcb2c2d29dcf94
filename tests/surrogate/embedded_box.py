"""Grids embedded on a box that is meshed with a regular grid of nodes, finer or coarser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shared_schema.grid import Grid


def between(positions: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Points, counted x slowest, and weights at positions in steps of a grid: (n, 2^d) each."""
    first = np.clip(np.floor(positions + 1e-9).astype(int), 0, np.asarray(shape) - 2)
    part, points, weights = positions - first, [], []
    for corner in np.ndindex(*(2,) * len(shape)):
        points.append(np.ravel_multi_index(tuple((first + corner).T), shape))
        weights.append(np.where(corner, part, 1 - part).prod(axis=1))
    return np.stack(points, axis=1), np.stack(weights, axis=1)


def on_points(*shape: int) -> Callable[[Grid], Grid]:
    """Return what embeds a grid of a shape: both operators are multilinear."""

    def embed(nodes: Grid) -> Grid:
        ratio = (np.asarray(shape) - 1) / (np.asarray(nodes.shape) - 1)
        numbers = np.empty((nodes.nodes, len(shape)))
        numbers[nodes.node_at.ravel()] = np.argwhere(np.ones(nodes.shape))
        points, weights = between(numbers * ratio, shape)
        sources, source_weights = between(np.argwhere(np.ones(shape)) / ratio, nodes.shape)
        at = nodes.node_at.ravel()[sources]
        return Grid(at.reshape(*shape, -1), source_weights.reshape(*shape, -1), points, weights)

    return embed
