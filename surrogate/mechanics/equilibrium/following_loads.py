"""Loads that follow a body, as the factory has them: pressures and cables, forces and tangent.

Unit forces are those of `shared_schema.common.bodies.following_loads`. A pressure on a surface that
is closed, or whose edge is held, has a symmetric tangent, and so has a cable; a pressure at a free
edge has not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.bodies.following_loads import FollowingLoad, PressedSurface
from shared_schema.common.bodies.points_between import PointsBetween
from surrogate.mechanics.body.geometry import Geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FollowingLoads:
    """Loads of one amplitude each, in N load cases on one body.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        Positions of the undeformed body in m; those of all points if loads act between the nodes.
    units : tuple of FollowingLoad
        Loads of unit amplitude: surfaces under pressure, then cables.
    amplitudes : array, (N, n)
        Pressures in Pa, of which those that push into the body are positive; tensions in N.
    points : PointsBetween or None
        Points between the nodes on which they act; None if these are the nodes.
    """

    coordinates: Array
    units: tuple[FollowingLoad, ...]
    amplitudes: Array
    points: PointsBetween | None = None

    @classmethod
    def of(cls, geometry: Geometry, amplitudes: Array) -> FollowingLoads:
        """Those of the case of a body, with some amplitudes."""
        points = geometry.pressed_points
        return cls.on(geometry.coordinates, geometry.following, amplitudes, points)

    @classmethod
    def on(
        cls,
        coordinates: Array,
        units: Sequence[FollowingLoad],
        amplitudes: Array,
        points: PointsBetween | None,
    ) -> FollowingLoads:
        """Loads on a body with nodes at some positions, which may have `points`."""
        at = coordinates if points is None else points.interpolated(coordinates)
        return cls(at, tuple(units), amplitudes, points)

    @classmethod
    def of_load(cls, given: CommandLoads) -> FollowingLoads | None:
        """Those of a command's load as one load case; None if it has none."""
        if not given.surfaces:
            return None
        body, amplitudes = given.body, np.array([given.pressures])
        units = [PressedSurface(facets) for facets in given.surfaces]
        return cls.on(body.coordinates, units, amplitudes, body.points)

    def __getitem__(self, cases: slice | NDArray[np.int64]) -> FollowingLoads:
        """Those of some of the load cases."""
        return replace(self, amplitudes=self.amplitudes[cases])

    def beside(self, others: FollowingLoads) -> FollowingLoads:
        """These and others, on the same points of the same load cases."""
        amplitudes = np.concatenate([self.amplitudes, others.amplitudes], axis=1)
        return replace(self, units=(*self.units, *others.units), amplitudes=amplitudes)

    def scaled(self, factor: float) -> FollowingLoads:
        """The same part of all."""
        return replace(self, amplitudes=factor * self.amplitudes)

    def forces(self, u: Array) -> Array:
        """Forces on the deformed body: (N, n_nodes, d) in m → same in N."""
        total = np.zeros(u.shape)
        for case, unit, amplitude in self._acting():
            total[case] += amplitude * unit.forces(self.coordinates + u[case])
        return total

    @property
    def at_rest(self) -> Array:
        """Forces on the undeformed body in N, (N, n_nodes, d)."""
        return self.forces(np.zeros((len(self.amplitudes), *self.coordinates.shape)))

    @property
    def load(self) -> Array:
        """`at_rest` as a load, at the nodes and between them."""
        f, points = self.at_rest, self.points
        if points is None:
            return f
        return np.concatenate([points.on_nodes(f), f[:, points.nodes :]], axis=1)

    def tangents(self, u: Array) -> Iterator[tuple[int, NDArray[np.int64], Array]]:
        """Yield what the forces add to the tangent, −∂f/∂u, part after part.

        Parameters
        ----------
        u : array, (N, n_nodes, d)
            In m.

        Yields
        ------
        case : int
            Number of the load case.
        points : array of int, (n, k)
            Points of facets, or of the legs of a cable.
        blocks : array, (n, k d, k d)
            In N/m.
        """
        for case, unit, amplitude in self._acting():
            for points, blocks in unit.tangents(self.coordinates + u[case]):
                yield case, points, amplitude * blocks

    def _acting(self) -> Iterator[tuple[int, FollowingLoad, float]]:
        for case, amplitudes in enumerate(self.amplitudes):
            for unit, amplitude in zip(self.units, amplitudes, strict=True):
                if amplitude:
                    yield case, unit, float(amplitude)
