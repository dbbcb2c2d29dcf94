"""A rigid tool that has moved without turning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.tools.tool import Tool, require_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Displaced(Tool):
    """Another tool, elsewhere.

    Parameters
    ----------
    tool : Tool
    by : tuple of d floats
        How far it has moved, in m.

    Raises
    ------
    InputError
        If that is not finite, or of another dimension.
    """

    form: ClassVar[str] = "displaced"

    tool: Tool
    by: tuple[float, ...]

    def __post_init__(self) -> None:
        require_points(self.form, self.by, (0.0,) * self.tool.dimension)

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return self.tool.dimension

    @property
    def size(self) -> float:
        """Largest coordinate or length that describes it, in m."""
        return self.tool.size + float(np.abs(self.by).max())

    def gap(self, x: Array) -> Array:
        """Signed distance in m of positions: (n, d) → (n,)."""
        return self.tool.gap(x - self.by)

    def normal(self, x: Array) -> Array:
        """Gradient of the distance, of length 1: (n, d) → same."""
        return self.tool.normal(x - self.by)

    def curvature(self, x: Array) -> Array:
        """Hessian of the distance in 1/m: (n, d) → (n, d, d)."""
        return self.tool.curvature(x - self.by)
