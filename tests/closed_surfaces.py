"""Closed surfaces of triangles, and files of them."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
FACES = np.array(  # of the cube, seen from outside
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def surface_file(path: Path, points: Array = CUBE, triangles: Triangles = FACES) -> Path:
    """Write a file, by default of the unit cube."""
    meshio.write(path, meshio.Mesh(points, [("triangle", triangles)]))
    return path


def ball(count: int) -> tuple[Array, Triangles]:
    """A unit sphere of triangles between the points of a spiral, seen from outside."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - height**2)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    triangles = ConvexHull(points).simplices
    turned = np.linalg.det(points[triangles]) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return points, triangles.astype(np.int64)
