"""Random loads of a body: those of its case, and families of forces at its nodes.

Uniform body forces and patches of traction are those of `datagen`, drawn by another generator.
Cases with other families have random forces on random nodes, as many and as large as those of the
training.

A family of forces is written ``loads=1-8,reach=2,places=free``: the numbers of loaded nodes, the
largest force component over that of the training, and the nodes that may be loaded: those of the
training (``trained``), those of the surface that are free (``surface``), or all free ones
(``free``). What is not given is as in the training; so ``trained`` alone is the family of the
training itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.distributed_loads import SurfacePatches, nodal_volumes
from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]
TRAINED = "trained"
PLACES = (TRAINED, "surface", "free")
MOST_REACH = 1e6
EVERYWHERE = {"body_force": ({},), "traction_patch": ({}, {"boundary": True})}  # regions


@dataclass(frozen=True)
class RandomLoads:
    """Random forces on random nodes.

    Attributes
    ----------
    nodes : array of int
        Nodes that may be loaded.
    fewest, most : int
        Numbers of loaded nodes; each number between them is as likely.
    limit : array, (d,)
        Largest force components in N; components are drawn evenly between minus and plus this.
    body_nodes : int
        Number of all nodes of the body.
    free : array of bool, (n_nodes, d), optional
        Components that are not held: no force acts on others.
    """

    nodes: NDArray[np.int64]
    fewest: int
    most: int
    limit: Array
    body_nodes: int
    free: NDArray[np.bool_] | None = None

    def draw(self, count: int, random: np.random.Generator) -> Array:
        """Draw nodal forces in N, (count, n_nodes, d)."""
        forces = np.zeros((count, self.body_nodes, len(self.limit)))
        for force in forces:
            number = int(random.integers(self.fewest, self.most + 1))
            chosen = random.choice(self.nodes, number, replace=False)
            force[chosen] = random.uniform(-self.limit, self.limit, (number, len(self.limit)))
        return forces if self.free is None else forces * self.free


def random_loads(
    family: str, geometry: Geometry, limit: tuple[float, ...], numbers: tuple[int, int]
) -> RandomLoads:
    """Make the family that a text describes.

    Parameters
    ----------
    family : str
        Such as ``trained`` or ``loads=1-8,reach=2,places=free``.
    geometry : Geometry
    limit : tuple of d floats
        Largest force components of the training in N.
    numbers : tuple of 2 ints
        Smallest and largest number of loaded nodes in the training.

    Raises
    ------
    InputError
        If the text is not of that form, or the body has too few such nodes.
    """
    keys = dict(_keys(family))
    counts = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", keys.get("loads", "1"))
    if counts is None:
        raise _wrong(family, "loads", keys["loads"], "a number such as 3, or a range such as 1-8")
    fewest, most = int(counts[1]), int(counts[2] or counts[1])
    if "loads" not in keys:
        fewest, most = numbers
    places = keys.get("places", TRAINED)
    if places not in PLACES:
        raise _wrong(family, "places", places, f"one of {', '.join(PLACES)}")
    try:
        reach = float(keys.get("reach", "1"))
    except ValueError:
        reach = 0.0
    if not 0 < reach <= MOST_REACH:
        raise _wrong(family, "reach", keys["reach"], "a positive number")
    nodes = np.flatnonzero(_allowed(places, geometry))
    if not 1 <= fewest <= most <= len(nodes):
        expected = f"1 at least and {len(nodes)} at most, the number of nodes that may be loaded"
        raise _wrong(family, "loads", f"{fewest}-{most}", expected)
    largest, count = reach * np.array(limit), len(geometry.coordinates)
    return RandomLoads(nodes, fewest, most, largest, count, geometry.free)


def _keys(family: str) -> list[tuple[str, str]]:
    """Keys and values of the text."""
    if family == TRAINED:
        return []
    pairs = [part.partition("=") for part in family.split(",")]
    for key, _, _ in pairs:
        if key not in ("loads", "reach", "places"):
            raise InputError(
                f"family '{family}': '{key}', expected '{TRAINED}', or some of 'loads=', "
                "'reach=' and 'places=' separated by commas",
                "family",
            )
    return [(key, value) for key, _, value in pairs]


def _allowed(places: str, geometry: Geometry) -> NDArray[np.bool_]:
    """Nodes that may be loaded, (n_nodes,)."""
    if places == TRAINED:
        return geometry.loadable & ~geometry.clamped
    allowed = ~geometry.clamped
    if places == "surface":
        surface = np.zeros(len(allowed), dtype=np.bool_)
        surface[boundary_facets(geometry.cells, geometry.cell_type)] = True
        allowed &= surface
    return allowed


def _wrong(family: str, key: str, value: str, expected: str) -> InputError:
    return InputError(f"family '{family}': '{key}' = {value}, expected {expected}", "family")


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
