r"""The place of the surface that a single force acts on, from what markers tell.

A place is a node of the surface, or what lies within a radius of one, over which the force is
spread (`shared_schema.common.bodies.distributed_loads`).

A linear body moves the markers by :math:`A_a g` under a force g in place a, with columns of
:math:`K^{-1}` at the markers, which are those of unit forces at the markers (:math:`K^{-1}` is
symmetric). Places are ranked by the robust sum of squares that is left
(`surrogate.mechanics.identification.search`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from shared_schema.common.bodies.distributed_loads import SurfacePatches
from shared_schema.common.errors import InputError
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.identification.least_squares import FLOOR, cauchy
from surrogate.mechanics.statics.body import Body

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

ROUNDS = 6  # of weights
ROUNDING = 1e-12
FIRST = 3  # nodes of a ranking that are fitted


class Places:
    """Places of the surface, and how forces there move the markers of the linear body.

    Parameters
    ----------
    body : Body
    at_markers : csr_array, (m, n_nodes)
    beside : array, (m, d, K)
        Linear displacements of the markers by other sought forces of 1 N, in m.
    radii : sequence of float
        Radii in m that a force may be spread over; 0 on a node alone.
    sigma : float, optional
        Noise of a component in m.

    Attributes
    ----------
    nodes : array of int, (n,)
        In the middle of each place.
    radii : array, (n,)
        In m.

    Raises
    ------
    InputError
        If no part of the surface lies within the radius of a node.
    """

    def __init__(
        self,
        body: Body,
        at_markers: csr_array,
        beside: Array,
        radii: Sequence[float],
        sigma: float | None,
    ) -> None:
        geometry = body.geometry
        self.nodes, self.radii, self._shares = spread(geometry, radii)
        count, self._points = self._shares.shape[1], geometry.loaded_body.points
        self._free = body.equilibrium.free[:count]
        (m, d, _), shape = beside.shape, geometry.coordinates.shape
        unit = np.zeros((m, d, *shape))
        for axis in range(d):
            unit[:, axis, :, axis] = at_markers.toarray()
        units = body.equilibrium.forces_at_points(unit.reshape(m * d, *shape))
        columns = np.moveaxis(body.driven_body.compliance.linear_response(units), 1, 0)
        of_places = self._shares @ columns[:count].reshape(count, -1)
        of_nodes = of_places.reshape(len(self.nodes), m, d, d)
        others = np.broadcast_to(beside, (len(self.nodes), *beside.shape))
        self._matrix = np.concatenate([of_nodes, others], axis=-1)  # (n, m, d, d + K)
        self._sigma, self._dimension = sigma, d

    def units(self, number: int) -> Array:
        """Forces of 1 N along each axis in a place, (d, n_nodes or n_points, d)."""
        units = np.eye(self._dimension)[:, None] * self._shares[[number]].toarray()[0][:, None]
        if self._points is None:
            return np.asarray(units * self._free)
        nodes = self._points.nodes
        at_nodes = self._points.on_nodes(units) * self._free[:nodes]
        return np.concatenate([at_nodes, (units * self._free)[:, nodes:]], axis=1)

    def strengths(self, number: int) -> Array:
        """Largest displacement of a marker by each force of 1 N, (d + K,), in m."""
        return np.asarray(np.abs(self._matrix[number]).max(axis=(0, 1)))

    def moved(self, number: int, forces: Array) -> Array:
        """Displacements of the markers of the linear body in m, (m, d), by (d + K,) in N."""
        return np.asarray(self._matrix[number] @ forces)

    def ranked(self, moved: Array, count: int = FIRST) -> tuple[list[int], Array]:
        """Numbers of the first places, and the forces in N with which they fit, (count, d + K)."""
        shape = (len(self.nodes), moved.size, -1)  # one row a component of a marker
        matrix, weights = self._matrix.reshape(shape), np.ones(self._matrix.shape[:2])
        floor = FLOOR * float(np.abs(moved).max())
        for _ in range(ROUNDS):
            weighted = (weights[:, :, None, None] * self._matrix).reshape(shape).swapaxes(1, 2)
            normal = weighted @ matrix
            ridge = ROUNDING * np.trace(normal, axis1=1, axis2=2)
            normal += ridge[:, None, None] * np.eye(normal.shape[1])
            found = np.linalg.solve(normal, weighted @ moved.ravel()[:, None])
            off = np.linalg.norm(moved - (matrix @ found).reshape(*weights.shape, -1), axis=2)
            weights = cauchy(off / np.sqrt(self._dimension), self._sigma, floor)
        noise = self._sigma or max(float(np.median(off, axis=1).min()), floor)
        first = np.argsort(np.log1p((off / noise) ** 2).sum(axis=1))[:count]
        return list(map(int, first)), found[first, :, 0]


def spread(geometry: Geometry, radii: Sequence[float]) -> tuple[Numbers, Array, csr_array]:
    """Middles, radii in m, and part of the force on each point: (n,), (n,), (n, n_points).

    Raises
    ------
    InputError
        If there is no such place.
    """
    surface, x = geometry.surface_nodes, geometry.coordinates
    free = surface[geometry.free[surface].all(axis=1)]
    loaded, facets = geometry.loaded_body, geometry.surface_facets
    facets = facets if loaded.points is None else loaded.points.facets(facets)
    patches = SurfacePatches.of(loaded.positions, facets)
    nodes, sizes, shares = [], [], []
    for radius in radii:
        for node in map(int, free):
            weights = np.zeros(len(loaded.positions))
            if radius > 0:
                weights = patches.weights(x[node], radius)
            else:
                weights[node] = 1.0
            if total := float(weights.sum()):
                nodes.append(node)
                sizes.append(radius)
                shares.append(csr_array(weights[None] / total))
    if not nodes:
        raise InputError(
            f"unknown: somewhere,{radii[0]:g}: no part of the surface lies within "
            f"{geometry.units.written(radii[0])} of a node, expected a larger radius"
        )
    return np.array(nodes), np.array(sizes), csr_array(vstack(shares))
