r"""Places of the surface that a single force may act on, by what markers tell.

A place is a node of the surface, or what lies within a radius of one, over which the force is
spread (`shared_schema.common.bodies.distributed_loads`).

A linear body moves the markers by :math:`A_a g` under a force g in place a, with columns of
:math:`K^{-1}` at the markers, which are those of unit forces at the markers (:math:`K^{-1}` is
symmetric). Places are ranked by the robust sum of squares that is left
(`surrogate.mechanics.identification.search`).

Many places may bear a force that fits as well as the best one. From parameters that are close to a
fit, one Gauss–Newton step is enough, and the predictions of all places are one batch. With the
noise σ of the best fit, and all nodes of the surface and radii alike beforehand, the probability of
place a is

.. math:: p_a \propto \exp\Big(-\frac12 \sum_m \min(|r_m| / σ, c)^2\Big)

with what the step leaves of the markers, :math:`r_m`; wild ones count for a constant c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from shared_schema.common.bodies.distributed_loads import SurfacePatches
from shared_schema.common.errors import InputError, WorkError
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.identification.least_squares import (
    FLOOR,
    Fit,
    Point,
    cauchy,
    stepped,
    wild_cost,
)
from surrogate.mechanics.identification.responses import DIFFERENCE, differences
from surrogate.mechanics.identification.unknowns import Unknowns
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Predictor

Array = NDArray[np.float64]

SHARE = 1e-3  # probability of places that are left out of uncertainties


@dataclass(frozen=True)
class Candidate:
    """A fit of predictions.

    Attributes
    ----------
    unknowns : Unknowns
    fit : Fit
    scale : array, (p,)
    node : int or None
        Where the force acts that may act somewhere: the middle of its place.
    radius : float
        Of this place in m; 0 of a node alone.
    share : float
        Its probability among all places.
    """

    unknowns: Unknowns
    fit: Fit
    scale: Array
    node: int | None = None
    radius: float = 0.0
    share: float = 1.0


@dataclass(frozen=True)
class Start:
    """Parameters θ of a force in one place, (p,), with the sizes of changes that matter, (p,)."""

    unknowns: Unknowns
    theta: Array
    scale: Array
    node: int
    radius: float = 0.0


def joined(loads: list[Load]) -> Load:
    """Some load cases after others of the same body."""
    known = [each.following for each in loads if each.following is not None]
    dead = np.concatenate([each.dead for each in loads])
    if not known:
        return Load(dead)
    amplitudes = np.concatenate([each.amplitudes for each in known])
    return Load(dead, replace(known[0], amplitudes=amplitudes))


def likely_candidates(
    predictor: Predictor, moved: Array, at_markers: csr_array, best: Fit, starts: list[Start]
) -> list[Candidate]:
    """Take a step from every start, and return the candidates, the most likely one first.

    Parameters
    ----------
    predictor : Predictor
    moved : array, (m, d)
        Displacements of the markers in m.
    at_markers : csr_array, (m, n_nodes)
    best : Fit
        Of one of the places, whose noise and wild markers count.
    starts : list of Start
        At least one, from which predictions are finite.

    Raises
    ------
    WorkError
        If the markers do not determine the parameters of any.
    """
    points = [
        start.theta + np.vstack([0 * start.scale, np.diag(DIFFERENCE * start.scale)])
        for start in starts
    ]
    loads = [start.unknowns.load(at) for start, at in zip(starts, points, strict=True)]
    fields, _ = predictor.respond(joined(loads))
    of_starts = fields.reshape(len(starts), -1, *fields.shape[1:])
    found = []
    for start, fields in zip(starts, of_starts, strict=True):
        seen = np.array([at_markers @ field for field in fields])
        if not np.isfinite(seen).all():
            continue
        steps = DIFFERENCE * start.scale
        slopes, jacobian = (differences(of[1:], of[0], steps) for of in (fields, seen))
        point = Point(start.theta, fields[0], slopes, seen[0], jacobian)
        try:
            fit = stepped(best, moved, point, start.scale)
        except WorkError:
            continue
        found.append(Candidate(start.unknowns, fit, start.scale, start.node, start.radius))
    if not found:
        raise WorkError("the markers do not tell all that is sought")
    costs = np.array([wild_cost(one.fit.lengths, best.sigma) for one in found])
    shares = np.exp((costs.min() - costs) / 2)
    shares /= shares.sum()
    kept = [
        replace(one, share=float(share))
        for one, share in zip(found, shares, strict=True)
        if share > SHARE
    ]
    return sorted(kept, key=lambda one: -one.share)


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
