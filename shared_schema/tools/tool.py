"""Rigid tools: what all of them tell of a position, and what may push a body."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError

Array = NDArray[np.float64]
MOST = 1e6  # m: largest coordinate or radius


class Tool(ABC):
    """A rigid tool."""

    form: ClassVar[str]

    @abstractmethod
    def gap(self, x: Array) -> Array:
        """Signed distance in m of positions: (n, d) → (n,)."""

    @abstractmethod
    def normal(self, x: Array) -> Array:
        """Gradient of the distance, of length 1: (n, d) → same."""

    @abstractmethod
    def curvature(self, x: Array) -> Array:
        """Hessian of the distance in 1/m: (n, d) → (n, d, d)."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Number of space dimensions d."""

    @property
    @abstractmethod
    def size(self) -> float:
        """Largest coordinate or length that describes it, in m."""


def require_points(kind: str, *points: tuple[float, ...]) -> None:
    """Raise InputError unless all points have two or three finite components, as many each."""
    counts = {len(point) for point in points}
    if len(counts) > 1 or counts - {2, 3}:
        raise InputError(f"{kind}: expected 2 or 3 components, as many of each point")
    if not np.all(np.abs(points) <= MOST):  # true for NaN as well
        raise InputError(f"{kind}: expected finite numbers, at most {MOST:g}")


def require_radius(kind: str, radius: float) -> None:
    """Raise InputError unless a radius is positive and finite."""
    if not 0 < radius <= MOST:
        raise InputError(f"{kind}: radius {radius:g}: expected more than 0, at most {MOST:g} m")


def require_outside(tool: Tool, coordinates: Array, free: NDArray[np.bool_]) -> None:
    """Raise InputError unless a tool can push a body.

    Parameters
    ----------
    tool : Tool
    coordinates : array, (n_nodes, d)
        Undeformed positions in m.
    free : array of bool, (n_nodes, d)
        Components of displacement that are not held.

    Raises
    ------
    InputError
        If the tool is of another dimension, overlaps nodes that are wholly held, or has the body
        all inside.
    """
    d = coordinates.shape[1]
    if tool.dimension != d:
        raise InputError(f"the tool has points of {tool.dimension} components, expected {d}")
    gap = tool.gap(coordinates)
    if gap[~free.any(axis=1)].min(initial=0.0) < 0:
        raise InputError("the tool overlaps nodes that are held, expected it elsewhere")
    if gap.max() < 0:
        raise InputError("the whole body lies inside the tool")
