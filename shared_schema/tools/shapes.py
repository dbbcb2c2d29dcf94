r"""Planes, spheres and capsules.

.. math::
    g(x) = n · (x - x_0), \qquad g(x) = |x - c| - R, \qquad
    g(x) = \min_{0 \le t \le 1} |x - a - t (b - a)| - R

with their gradients, which are the outward normals, and their Hessians.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.tools.tool import Tool, require_points, require_radius

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plane(Tool):
    """A half space.

    Attributes
    ----------
    point, normal_vector : tuple of d floats
        A point on its surface in m, and the direction out of it, of any length.
    """

    point: tuple[float, ...]
    normal_vector: tuple[float, ...]
    form: ClassVar[str] = "plane:X,Y[,Z]:NX,NY[,NZ]"

    def __post_init__(self) -> None:
        """Raise InputError unless both are finite and fit each other."""
        require_points("plane", self.point, self.normal_vector)
        if not np.linalg.norm(self.normal_vector) > 0:
            raise InputError("plane: expected a normal other than 0")

    @property
    def dimension(self) -> int:
        """Number of space dimensions."""
        return len(self.point)

    @property
    def size(self) -> float:
        """Largest coordinate of its point."""
        return float(np.abs(self.point).max())

    @property
    def _unit(self) -> Array:
        vector = np.array(self.normal_vector)
        return np.asarray(vector / np.linalg.norm(vector))

    def gap(self, x: Array) -> Array:
        """Signed distance."""
        return np.asarray((x - np.array(self.point)) @ self._unit)

    def normal(self, x: Array) -> Array:
        """Its gradient."""
        return np.broadcast_to(self._unit, x.shape)

    def curvature(self, x: Array) -> Array:
        """Its Hessian, which is 0."""
        return np.zeros((*x.shape, x.shape[1]))


@dataclass(frozen=True)
class Capsule(Tool):
    """All points within a radius of a segment.

    Attributes
    ----------
    begin, end : tuple of d floats
        Ends of the segment in m.
    radius : float
        In m.
    """

    begin: tuple[float, ...]
    end: tuple[float, ...]
    radius: float
    form: ClassVar[str] = "capsule:X,Y[,Z]:X,Y[,Z]:R"

    def __post_init__(self) -> None:
        """Raise InputError unless the numbers are finite and the radius is positive."""
        kind = type(self).__name__.lower()
        require_points(kind, self.begin, self.end)
        require_radius(kind, self.radius)

    @property
    def dimension(self) -> int:
        """Number of space dimensions."""
        return len(self.begin)

    @property
    def size(self) -> float:
        """Largest coordinate of its ends, or its radius."""
        return max(float(np.abs((self.begin, self.end)).max()), self.radius)

    def gap(self, x: Array) -> Array:
        """Signed distance."""
        return np.asarray(np.linalg.norm(self._offset(x)[0], axis=1) - self.radius)

    def normal(self, x: Array) -> Array:
        """Its gradient; an axis at points of the segment, where there is none."""
        return unit_vectors(self._offset(x)[0])

    def curvature(self, x: Array) -> Array:
        """Its Hessian: (I − n nᵀ) / |x − …|, without the segment's direction beside it."""
        offset, beside = self._offset(x)
        length = np.linalg.norm(offset, axis=1)[:, None, None]
        n = unit_vectors(offset)
        across = np.eye(x.shape[1]) - n[:, :, None] * n[:, None, :]
        axis = np.array(self.end) - np.array(self.begin)
        unit = axis / (np.linalg.norm(axis) or 1.0)
        across = across - beside[:, None, None] * np.outer(unit, unit)
        return np.asarray(across / np.where(length > 0, length, np.inf))

    def _offset(self, x: Array) -> tuple[Array, NDArray[np.bool_]]:
        """From the nearest point of the segment, (n, d); True where it is inside of it."""
        a = np.array(self.begin)
        axis = np.array(self.end) - a
        square, offset = float(axis @ axis), x - a
        if square == 0:
            return offset, np.zeros(len(x), dtype=bool)
        t = offset @ axis / square
        return offset - np.clip(t, 0, 1)[:, None] * axis, (t > 0) & (t < 1)


@dataclass(frozen=True)
class Sphere(Capsule):
    """A sphere, or a disc in the plane: a capsule without length.

    Attributes
    ----------
    begin, end : tuple of d floats
        Its centre in m.
    radius : float
        In m.
    """

    form: ClassVar[str] = "sphere:X,Y[,Z]:R"

    def __init__(self, centre: tuple[float, ...], radius: float) -> None:
        super().__init__(tuple(centre), tuple(centre), radius)


def unit_vectors(offset: Array) -> Array:
    """Vectors over their lengths, (n, d); an axis where the length is 0."""
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    anywhere = np.eye(offset.shape[1])[0]
    return np.where(length > 0, offset / np.where(length > 0, length, 1), anywhere)
