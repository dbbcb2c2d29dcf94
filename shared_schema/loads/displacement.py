"""A random displacement of all nodes of the region together, such as that of a grip.

A dataset holds as nodal forces the reactions that hold the nodes there. Under these forces alone,
without the grip, the body is in the same equilibrium.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator

from shared_schema.common.keys.quantities import Length
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily, ascending, generator
from shared_schema.loads.regions import Region

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
