"""Random loads of a case's own families: uniform body forces, and patches of traction.

They are those of `datagen`, drawn by another generator. Cases with other families have random
forces on random nodes, as many and as large as those of the training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import SurfacePatches, nodal_volumes
from surrogate.learning.data.load_families import TRAINED, random_loads
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]
EVERYWHERE = {"body_force": ({},), "traction_patch": ({}, {"boundary": True})}  # regions


class Loads(Protocol):
    """What draws random loads."""

    def draw(self, count: int, random: np.random.Generator) -> Array:
        """Draw nodal forces in N, (count, n_nodes, d)."""


@dataclass(frozen=True)
class CaseLoads:
    """The sum of one load of each family of a case.

    Attributes
    ----------
    geometry : Geometry
    families : sequence of mappings
        Body forces and patches of traction anywhere on the body, as a case has them.
    """

    geometry: Geometry
    families: Sequence[Mapping[str, Any]]

    @cached_property
    def _volumes(self) -> Array:
        """What of the body belongs to each node, (n_nodes,) in m³."""
        return nodal_volumes(self.geometry.coordinates, self.geometry.cells)

    @cached_property
    def _surface(self) -> SurfacePatches:
        """Facets of the surface all of whose nodes can move."""
        body = self.geometry
        facets = boundary_facets(body.cells, body.cell_type)
        return SurfacePatches.of(body.coordinates, facets[~body.clamped[facets].any(axis=1)])

    def draw(self, count: int, random: np.random.Generator) -> Array:
        """Draw nodal forces in N, (count, n_nodes, d)."""
        x, centres = self.geometry.coordinates, np.unique(self._surface.facets)
        forces = np.zeros((count, *x.shape))
        for force in forces:
            for family in self.families:
                low, high = family["range"]
                if family["family"] == "body_force":
                    force += np.outer(self._volumes, random.uniform(low, high, x.shape[1]))
                    continue
                fewest, most = family.get("count", (1, 1))
                for _ in range(int(random.integers(fewest, most + 1))):
                    radius = random.uniform(*np.broadcast_to(family["radius"], 2))
                    weights = self._surface.weights(x[random.choice(centres)], radius)
                    force += np.outer(weights, random.uniform(low, high, x.shape[1]))
        return forces * self.geometry.free


def trained_loads(
    geometry: Geometry,
    case: Mapping[str, Any],
    limit: tuple[float, ...],
    numbers: tuple[int, int],
    family: str = TRAINED,
) -> Loads:
    """Random loads of a training, or of another family around them.

    Parameters
    ----------
    geometry : Geometry
    case : mapping
        The case; its own families are drawn if they are body forces and patches of traction
        anywhere on the body, and `family` is that of the training.
    limit, numbers, family
        As `random_loads` has them.

    Raises
    ------
    InputError
        If the family is wrong.
    """
    families = families_of(case)
    own = [region_of(of) in EVERYWHERE.get(of["family"], ()) for of in families]
    if family == TRAINED and families and all(own):
        return CaseLoads(geometry, families)
    return random_loads(family, geometry, limit, numbers)


def families_of(case: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Load families of a case; none if there is no case."""
    load = case.get("load", [])
    return [load] if isinstance(load, Mapping) else list(load)


def region_of(family: Mapping[str, Any]) -> dict[str, Any]:
    """What a family's region asks for."""
    return {key: value for key, value in (family.get("region") or {}).items() if value}
