"""A depth buffer: for every pixel of the paper, the distance of the nearest face.

It says which points of a surface other faces hide. Faces are sampled more finely than the pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PIXELS = 400  # along the larger side
BEHIND = 0.01  # least distance of a hidden point behind the face, as a part of the larger side


class DepthBuffer:
    """Depths of faces on the paper.

    Parameters
    ----------
    paper : array, (n_nodes, 2)
        Positions of the nodes on the paper in m.
    depth : array, (n_nodes,)
        Their distances behind the paper in m.
    faces : array of int, (n_faces, n_corners)
        Node numbers of plane convex faces.
    """

    def __init__(self, paper: Array, depth: Array, faces: NDArray[np.int64]) -> None:
        self._lower = paper.min(axis=0)
        side = float(np.ptp(paper, axis=0).max())
        self.pixel = side / PIXELS
        self._behind = BEHIND * side
        self._nearest = np.full((PIXELS + 2, PIXELS + 2), np.inf)
        corners = range(1, faces.shape[1] - 1)
        triangles = np.concatenate([faces[:, [0, i, i + 1]] for i in corners])
        point = np.concatenate((paper, depth[:, None]), axis=1)[triangles]
        sides = np.linalg.norm((point - np.roll(point, 1, axis=1))[..., :2], axis=2)
        steps = 2 ** np.ceil(np.log2(np.maximum(sides.max(axis=1) / self.pixel, 1))).astype(int)
        for n in np.unique(steps):
            share = _lattice(int(n))
            samples = np.einsum("sc,tcd->tsd", share, point[steps == n]).reshape(-1, 3)
            np.minimum.at(self._nearest, self._place(samples[:, :2]), samples[:, 2])

    def hides(self, paper: Array, depth: Array) -> NDArray[np.bool_]:
        """Whether faces hide points at these positions (…, 2) and depths (…): bool (…)."""
        return np.asarray(depth > self._nearest[self._place(paper)] + self._behind)

    def _place(self, paper: Array) -> tuple[NDArray[np.int64], ...]:
        """Rows and columns of points (…, 2); those outside are in the empty last ones."""
        cell = np.floor((paper - self._lower) / self.pixel).astype(np.int64)
        outside = ((cell < 0) | (cell > PIXELS)).any(axis=-1)
        cell[outside] = PIXELS + 1
        return cell[..., 0], cell[..., 1]


def _lattice(n: int) -> Array:
    """Barycentric coordinates of the points of a triangle whose sides are cut in n parts."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    inside = i + j <= n
    first, second = i[inside] / n, j[inside] / n
    return np.stack((first, second, 1 - first - second), axis=1)
