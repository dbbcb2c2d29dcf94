"""Bodies for drawings: a box of cells, a tube, a ball."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DrawnBody:
    """A mesh that can be drawn."""

    coordinates: np.ndarray
    cells: np.ndarray
    cell_type: str


def tube(inner: float, outer: float, length: float, around: int = 32) -> DrawnBody:
    """Make a tube along z of hexahedra, two through its wall and eight along it."""
    through, along = 2, 8
    angle = np.arange(around) * 2 * np.pi / around
    radius, height = np.linspace(inner, outer, through + 1), np.linspace(0, length, along + 1)
    a, r, z = (g.ravel() for g in np.meshgrid(angle, radius, height, indexing="ij"))
    number = np.arange(len(a)).reshape(around, through + 1, along + 1)
    low = number, np.roll(number, -1, axis=0)
    corners = [
        low[i][:, j : j + through, k : k + along].ravel()
        for k in (0, 1)
        for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))
    ]
    x = np.stack((r * np.cos(a), r * np.sin(a), z), axis=1)
    return DrawnBody(x, np.stack(corners, axis=1), "hexahedron")


def ball(radius: float, n: int = 12) -> DrawnBody:
    """Make a ball of hexahedra, a cube of n cells a side pressed into its round shape."""
    number = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    cube = np.argwhere(number >= 0) * 2 / n - 1
    largest = np.abs(cube).max(axis=1, keepdims=True)
    length = np.linalg.norm(cube, axis=1, keepdims=True)
    x = radius * cube * np.divide(largest, length, out=np.zeros_like(largest), where=length > 0)
    low, high = slice(None, -1), slice(1, None)
    square = ((low, low), (high, low), (high, high), (low, high))
    cells = np.stack([number[(*s, z)].ravel() for z in (low, high) for s in square], axis=1)
    return DrawnBody(x, cells, "hexahedron")
