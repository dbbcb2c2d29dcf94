r"""Families that move a body: a displacement of all nodes of a region, and a rigid tool.

Of a grip, a dataset holds as nodal forces the reactions that hold the nodes there. Under these
forces alone, without the grip, the body is in the same equilibrium.

The tool is a rigid ball that is pressed into the surface at a random place, a disc in the plane.
Its centre is :math:`c = X_a + (R - δ) \, m` with a random node a of the region, the radius R, the
depth δ by which it overlaps the undeformed body there, and a direction m about the outward normal
of the surface. The body keeps out of it, without friction
(`datagen.solver.tool_contact`). A dataset holds the forces of the contact as nodal forces:
as dead loads they give the same displacement.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator

from shared_schema.common.bodies.distributed_loads import area_vectors
from shared_schema.common.units import Length, Size
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily, ascending, generator
from shared_schema.loads.regions import Region
from shared_schema.tools import Sphere

Axis = Literal["x", "y", "z"]
LengthRange = Annotated[tuple[Length, Length], AfterValidator(ascending)]


class Displacement(LoadFamily):
    """The same displacement of all nodes of the region, drawn from U(low, high).

    Attributes
    ----------
    region : Region
    range : tuple of 2 floats
        (low, high) of each prescribed component, in m.
    components : tuple of "x", "y", "z"
        Components that are prescribed, all by default; the others are free.
    """

    of_sides: ClassVar[bool] = True

    region: Region
    range: LengthRange
    components: tuple[Axis, ...] = Field(("x", "y", "z"), min_length=1)

    @field_validator("components")
    @classmethod
    def _are_different(cls, value: tuple[Axis, ...]) -> tuple[Axis, ...]:
        if len(set(value)) != len(value):
            raise ValueError("expected each component once")
        return value

    def moves(self, dimension: int) -> tuple[bool, ...]:
        """Say which components are prescribed."""
        return tuple(axis in self.components for axis in ("x", "y", "z")[:dimension])

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless a component of the body's dimension is prescribed."""
        if not any(self.moves(loadable.dimension)):
            raise ValueError(f"key 'components' = {self.components}: the body is in the plane")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the displacement."""
        drawn = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        nothing = np.empty(0, dtype=np.int64), np.empty((0, loadable.dimension))
        return LoadCase(*nothing, displacement=drawn * self.moves(loadable.dimension))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of moved nodes: all nodes of the region."""
        return len(loadable)


Array = NDArray[np.float64]
POSES = 100  # tried, until one does not overlap the supports


class ToolPress(LoadFamily):
    """A ball pressed into the surface.

    Attributes
    ----------
    region : Region
        Where the ball comes down; the whole surface by default.
    radius : float or tuple of 2 floats
        R in m, or (low, high) that it is drawn from.
    depth : tuple of 2 floats
        (low, high) of δ in m.
    tilt : float
        Largest angle in degrees between m and the normal; 0 by default.
    """

    touches: ClassVar[bool] = True
    of_sides: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    radius: Size | tuple[Size, Size]
    depth: LengthRange
    tilt: float = Field(0.0, ge=0, lt=90)

    @field_validator("radius")
    @classmethod
    def _ascends(cls, value: float | tuple[float, float]) -> float | tuple[float, float]:
        return ascending(value) if isinstance(value, tuple) else value

    @field_validator("depth")
    @classmethod
    def _presses(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] < 0:
            raise ValueError("expected depths of 0 m at least")
        return value

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the region has nodes of the surface, and a pose is found."""
        if not np.isin(loadable.nodes, loadable.surface).any():
            raise ValueError("key 'region': no node of it is on the surface")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw node, radius, depth and direction, until the ball does not overlap the supports."""
        random, d = generator(seed, number), loadable.dimension
        x = loadable.coordinates
        outwards = area_vectors(x, loadable.surface)
        places = np.intersect1d(loadable.nodes, loadable.surface)
        clamped = np.empty(0, np.int64) if loadable.clamped is None else loadable.clamped
        nothing = np.empty(0, dtype=np.int64), np.empty((0, d))
        for _ in range(POSES):
            node = random.choice(places)
            radius = float(random.uniform(*np.broadcast_to(self.radius, 2)))
            depth = random.uniform(*self.depth)
            normal = outwards[node] / np.linalg.norm(outwards[node])
            away = turned(normal, np.deg2rad(random.uniform(0, self.tilt)), random)
            ball = Sphere(tuple(map(float, x[node] + (radius - depth) * away)), radius)
            if ball.gap(x[clamped]).min(initial=np.inf) > 0 and ball.gap(x).max() > 0:
                return LoadCase(*nothing, tool=ball)
        raise ValueError(f"{POSES} balls overlap the supports, expected a region away from them")

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of nodes of the surface, all of which the ball may touch."""
        return len(np.unique(loadable.surface))


def turned(direction: Array, angle: float, random: np.random.Generator) -> Array:
    """Turn a unit vector by an angle in radians, in a random plane."""
    across = random.normal(size=direction.shape)
    across -= (across @ direction) * direction
    across /= np.linalg.norm(across)
    return np.asarray(np.cos(angle) * direction + np.sin(angle) * across)
