r"""Rigid tools: planes, spheres, capsules, and what they do to a body.

.. math::
    g(x) = n · (x - x_0), \qquad g(x) = |x - c| - R, \qquad
    g(x) = \min_{0 \le t \le 1} |x - a - t (b - a)| - R

with their gradients, which are the outward normals, and their Hessians.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from shared_schema.common.units import Units

Array = NDArray[np.float64]
MOST = 1e6  # m: largest coordinate or radius
FEWEST = {2: 3, 3: 8}  # touched nodes by dimension: fewer may miss a tenth of the force, or half
FEW = (
    "; so few nodes: the force depends on the mesh, cells at the contact of at most a third of the "
    "tool's radius are wanted"
)


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

    @property
    def inside(self) -> Array | None:
        """A point of it in m, (d,), that a body can have inside; None of one without an end."""
        return None


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

    @property
    def inside(self) -> Array:
        """Its first end, of a sphere the middle."""
        return np.array(self.begin)

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

    @property
    def inside(self) -> Array | None:
        """That of the other tool, moved."""
        point = self.tool.inside
        return None if point is None else point + self.by

    def gap(self, x: Array) -> Array:
        """Signed distance in m of positions: (n, d) → (n,)."""
        return self.tool.gap(x - self.by)

    def normal(self, x: Array) -> Array:
        """Gradient of the distance, of length 1: (n, d) → same."""
        return self.tool.normal(x - self.by)

    def curvature(self, x: Array) -> Array:
        """Hessian of the distance in 1/m: (n, d) → (n, d, d)."""
        return self.tool.curvature(x - self.by)


@dataclass(frozen=True)
class Contact:
    """What a tool does to a body.

    Attributes
    ----------
    force : array, (n_nodes, d)
        Forces of the tool on the nodes in N.
    penetration : float
        Largest depth of a node inside the tool in m.
    """

    force: Array
    penetration: float

    @property
    def reaction(self) -> Array:
        """Resultant of the tool's forces on the body in N, (d,)."""
        return np.asarray(self.force.sum(axis=0))

    @property
    def nodes(self) -> int:
        """Number of nodes that bear a force."""
        return int(self.force.any(axis=1).sum())


def contact_line(contact: Contact, units: Units) -> str:
    """Describe what a tool does, and say whether so few nodes touch it that the mesh matters."""
    total = ",".join(f"{value:.6g}" for value in contact.reaction)
    remark = FEW if 0 < contact.nodes < FEWEST[len(contact.reaction)] else ""
    return (
        f"tool: force {total} {units.force} on {contact.nodes} nodes, penetration "
        f"{contact.penetration:.2g} {units.length}{remark}"
    )
