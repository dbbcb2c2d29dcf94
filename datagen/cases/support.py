"""Supports of a case: regions that are clamped, or held in single components."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from shared_schema.common.configuration import absent
from shared_schema.loads.regions import AXES, Region

Axis = Literal["x", "y", "z"]


class Support(Region):
    """Region whose nodes do not move, or slide.

    Attributes
    ----------
    components : tuple of "x", "y", "z", optional
        Components of the displacement that are held at zero; all by default. Those of a symmetry
        plane x = 0 are [x].
    """

    components: tuple[Axis, ...] | None = Field(None, min_length=1, exclude_if=absent)

    @field_validator("components")
    @classmethod
    def _are_different(cls, value: tuple[Axis, ...] | None) -> tuple[Axis, ...] | None:
        if value is not None and len(set(value)) != len(value):
            raise ValueError("expected each component once")
        return value

    def holds(self, dimension: int) -> NDArray[np.bool_]:
        """Components that are held, (d,)."""
        return np.array([self.components is None or a in self.components for a in AXES[:dimension]])
