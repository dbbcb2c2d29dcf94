"""A sweep of force magnitudes at one node in one direction."""

from __future__ import annotations

import numpy as np
from pydantic import Field, field_validator

from shared_schema.common.keys.quantities import Magnitude
from shared_schema.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily


class Sweep(LoadFamily):
    """Magnitudes in equal steps from low to high, both included: sample i has the i-th magnitude.

    The paper's sweeps are −8…8 N, −6…6 N and −4…4 N.

    Attributes
    ----------
    direction : tuple of d floats
        Direction of the force, of any length but zero.
    range : tuple of 2 floats
        (low, high) of the magnitude, in N; negative magnitudes point against the direction.
    steps : int
        Number of magnitudes; sample number `steps` starts again at low.
    """

    direction: tuple[Magnitude, ...] = Field(min_length=2, max_length=3)
    range: ForceRange
    steps: int = Field(gt=1, le=10**6)

    @field_validator("direction")
    @classmethod
    def _has_length(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not any(value):
            raise ValueError("expected a vector other than zero")
        return value

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the direction has d components and the region is one node."""
        loadable.require_components("direction", self.direction)
        if len(loadable) != 1:
            raise ValueError(f"key 'region': has {len(loadable)} nodes, expected one to sweep at")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Load the node with the next magnitude."""
        magnitude = np.linspace(*self.range, self.steps)[number % self.steps]
        direction = np.asarray(self.direction) / np.linalg.norm(self.direction)
        return LoadCase(loadable.nodes, magnitude * direction[None])

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1
