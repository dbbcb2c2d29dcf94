"""The surface of a kidney, for tests and measurements that begin with a file of triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def kidney(path: Path, around: int = 24) -> Path:
    """Write the surface of a bean of 0.1 m, in binary STL, with so many triangles around it."""
    a, b = np.meshgrid(
        np.linspace(0, np.pi, around // 2 + 1),
        np.linspace(0, 2 * np.pi, around, endpoint=False),
        indexing="ij",
    )
    x, y, z = 0.05 * np.cos(a), 0.025 * np.sin(a) * np.cos(b), 0.02 * np.sin(a) * np.sin(b)
    at = np.stack([x, y - 8 * x**2, z], axis=2)
    p, q = at, np.roll(at, -1, axis=1)
    triangles = np.concatenate(
        [np.stack([p[:-1], p[1:], q[1:]], 2), np.stack([p[:-1], q[1:], q[:-1]], 2)]
    ).reshape(-1, 3, 3)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    triangles = triangles[np.linalg.norm(sides, axis=1) > 1e-12]
    rows = np.zeros(len(triangles), [("n", "<3f4"), ("x", "<(3,3)f4"), ("a", "<u2")])
    rows["x"] = triangles
    path.write_bytes(bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return path
