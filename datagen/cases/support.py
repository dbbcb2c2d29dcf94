"""Supports of a case: regions that are clamped, or held in single components."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from datagen.mesh.regions import AXES, Region
from shared_schema.common.configuration import absent

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


def rigid_modes(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacements of the rigid motions of a body, rotations about its middle.

    Parameters
    ----------
    positions : array, (n_nodes, d)
        In m; the modes have no unit, lengths are relative to the size of the body.

    Returns
    -------
    array, (n_nodes, d, 3 or 6)
    """
    count, d = positions.shape
    x = (positions - positions.mean(axis=0)) / max(float(np.ptp(positions, axis=0).max()), 1e-300)
    modes = [np.tile(np.eye(d)[axis], (count, 1)) for axis in range(d)]
    for a in range(d):
        for b in range(a + 1, d):
            turned = np.zeros((count, d))
            turned[:, a], turned[:, b] = -x[:, b], x[:, a]
            modes.append(turned)
    return np.stack(modes, axis=-1)


def can_move(positions: NDArray[np.float64], held: NDArray[np.bool_]) -> bool:
    """True if a connected body can move without a strain, (n_nodes, d) both."""
    modes = rigid_modes(positions)
    rows = modes[held]
    return int(np.linalg.matrix_rank(rows, tol=1e-6)) < modes.shape[-1] if len(rows) else True
