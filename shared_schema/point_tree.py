"""A k-d tree of points that is built with denormal numbers flushed to zero as well.

SciPy splits points that share their least coordinate at the next number above. Next to 0 this is a
denormal one; where a program flushes such numbers to zero, as the learner's commands do, the tree
splits without end. So the points are moved away from 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Array = NDArray[np.float64]


class PointTree:
    """Points, to be found by their distance.

    Parameters
    ----------
    points : array, (n, d)
    """

    def __init__(self, points: Array) -> None:
        lowest, highest = points.min(axis=0), points.max(axis=0)
        self._shift = float((highest - lowest).max()) - lowest
        self._tree = KDTree(points + self._shift)

    def query(self, x: Array, k: int = 1) -> tuple[Any, Any]:
        """Distances and numbers of the k nearest points: (m, d) → (m,) or (m, k) each."""
        return self._tree.query(x + self._shift, k)

    def query_ball_point(self, x: Array, radius: Array) -> NDArray[np.object_]:
        """Numbers of all points within a radius: (m, d) and (m,) → lists, (m,)."""
        found: NDArray[np.object_] = self._tree.query_ball_point(x + self._shift, radius)
        return found
