"""Pressures that follow the surface of a body, as the factory has them: forces and tangent.

The equations are those of `shared_schema.common.bodies.distributed_loads`. A pressure on a surface
that is closed, or whose edge is held, has a symmetric tangent; at a free edge it has not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.bodies.distributed_loads import facet_derivatives, pressure_forces
from shared_schema.common.bodies.points_between import PointsBetween

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FollowerPressure:
    """Pressures of N load cases on one body.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        Positions of the undeformed body in m; those of all points if the facets have some between
        the nodes.
    surfaces : tuple of array of int, (n_facets, n_corners)
        Facets of every surface, seen from outside.
    pressures : array, (N, n_surfaces)
        In Pa; those that push into the body are positive.
    points : PointsBetween or None
        Points of the facets between the nodes; None if these are spanned by their corners.
    """

    coordinates: Array
    surfaces: tuple[NDArray[np.int64], ...]
    pressures: Array
    points: PointsBetween | None = None

    @classmethod
    def on(
        cls,
        coordinates: Array,
        surfaces: Sequence[NDArray[np.int64]],
        pressures: Array,
        points: PointsBetween | None,
    ) -> FollowerPressure:
        """Pressures on facets of a body with nodes at some positions, which may have `points`."""
        at = coordinates if points is None else points.interpolated(coordinates)
        return cls(at, tuple(surfaces), pressures, points)

    @classmethod
    def of_load(cls, given: CommandLoads) -> FollowerPressure | None:
        """Pressures of a load as those of one load case; None if it has none."""
        if not given.surfaces:
            return None
        body, pressures = given.body, np.array([given.pressures])
        return cls.on(body.coordinates, given.surfaces, pressures, body.points)

    def __getitem__(self, cases: slice | NDArray[np.int64]) -> FollowerPressure:
        """Pressures of some of the load cases."""
        return replace(self, pressures=self.pressures[cases])

    def scaled(self, factor: float) -> FollowerPressure:
        """The same part of all pressures."""
        return replace(self, pressures=factor * self.pressures)

    def forces(self, u: Array) -> Array:
        """Forces on the deformed body: (N, n_nodes, d) in m → same in N."""
        total = np.zeros(u.shape)
        for case, surface, pressure in self._acting():
            total[case] += pressure_forces(self.coordinates + u[case], surface, pressure)
        return total

    @property
    def at_rest(self) -> Array:
        """Forces on the undeformed body in N, (N, n_nodes, d)."""
        return self.forces(np.zeros((len(self.pressures), *self.coordinates.shape)))

    @property
    def load(self) -> Array:
        """`at_rest` as a load, at the nodes and between them."""
        f, points = self.at_rest, self.points
        if points is None:
            return f
        return np.concatenate([points.on_nodes(f), f[:, points.nodes :]], axis=1)

    def tangents(self, u: Array) -> Iterator[tuple[int, NDArray[np.int64], Array]]:
        """Yield what the forces add to the tangent, −∂f/∂u, of one surface after the other.

        Parameters
        ----------
        u : array, (N, n_nodes, d)
            In m.

        Yields
        ------
        case : int
            Number of the load case.
        facets : array of int, (n_facets, n_corners)
        blocks : array, (n_facets, n_corners d, n_corners d)
            In N/m.
        """
        for case, surface, pressure in self._acting():
            yield case, surface, -facet_derivatives(self.coordinates + u[case], surface, pressure)

    def _acting(self) -> Iterator[tuple[int, NDArray[np.int64], float]]:
        for case, pressures in enumerate(self.pressures):
            for surface, pressure in zip(self.surfaces, pressures, strict=True):
                if pressure:
                    yield case, surface, float(pressure)
