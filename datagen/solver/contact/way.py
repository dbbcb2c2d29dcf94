r"""The way on which a tool comes to its place.

The tool is displaced from its place by :math:`a(s)`, which goes along straight lines from the first
given point over all others to 0, and has gone the part s of their length at the load factor s. A
position x of the body is at :math:`x - a(s)` in the frame of the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.tools import Tool

Array = NDArray[np.float64]


class Way:
    """Way of a tool.

    Parameters
    ----------
    points : array, (n, d)
        Displacements of the tool from its place in m, in turn; none if it does not move.
    """

    def __init__(self, points: Array) -> None:
        self._points = np.concatenate([points, np.zeros((1, points.shape[1]))])
        lengths = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
        reached = np.concatenate([[0.0], np.cumsum(lengths)])
        self._parts = reached / reached[-1] if reached[-1] > 0 else reached

    def at(self, factor: float) -> Array:
        """Displacement a(s) of the tool from its place in m, (d,)."""
        if self._parts[-1] == 0:
            return np.asarray(self._points[-1])
        return np.array([np.interp(factor, self._parts, axis) for axis in self._points.T])


def require_free_begin(way: Way, tool: Tool, coordinates: Array) -> None:
    """Raise InputError if a tool overlaps nodes of the undeformed body where its way begins."""
    depth = -float(tool.gap(coordinates - way.at(0.0)).min())
    if depth > 0:
        raise InputError(
            f"the tool's way begins {depth:.3g} m inside the body, expected it outside"
        )
