r"""The node of the surface that a single force acts on, from what markers tell.

A linear body moves the markers by :math:`A_a g` under a force g on node a, with columns of
:math:`K^{-1}` at the markers, which are those of unit forces at the markers (:math:`K^{-1}` is
symmetric). Nodes are ranked by the robust sum of squares that is left. The first ones are fitted,
with the predictions in place of the linear body. What these move the markers more than the linear
body does, under the best force found, is then taken from the measured displacements, and the nodes
are ranked again, until no new ones are among the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import WorkError
from shared_schema.point_tree import PointTree
from surrogate.identification.least_squares import FLOOR, WILD, Fit, cauchy
from surrogate.identification.responses import Body

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

ROUNDS = 6  # of weights
ROUNDING = 1e-12
FIRST = 5  # nodes of a ranking that are fitted
NEIGHBOURS = 6  # nodes around the best one that are fitted
RANKINGS = 6


class Places:
    """Nodes of the surface, and how forces there move the markers of the linear body.

    Parameters
    ----------
    body : Surrogate
    at_markers : csr_array, (m, n_nodes)
    beside : array, (m, d, K)
        Linear displacements of the markers by other sought forces of 1 N, in m.
    sigma : float, optional
        Noise of a component in m.

    Attributes
    ----------
    nodes : array of int, (n,)
    """

    def __init__(
        self, body: Body, at_markers: csr_array, beside: Array, sigma: float | None
    ) -> None:
        geometry = body.geometry
        on_surface = geometry.surface_nodes
        self.nodes: Numbers = on_surface[geometry.free[on_surface].all(axis=1)]
        (m, d, _), shape = beside.shape, geometry.coordinates.shape
        unit = np.zeros((m, d, *shape))
        for axis in range(d):
            unit[:, axis, :, axis] = at_markers.toarray()
        columns = body.equilibrium.linear_response(unit.reshape(m * d, *shape))[:, self.nodes]
        of_nodes = np.moveaxis(columns, 1, 0).reshape(len(self.nodes), m, d, d)
        others = np.broadcast_to(beside, (len(self.nodes), *beside.shape))
        self._matrix = np.concatenate([of_nodes, others], axis=-1)  # (n, m, d, d + K)
        self._sigma, self._dimension = sigma, d
        self._places = geometry.coordinates[self.nodes]
        self._tree = PointTree(self._places)

    def strengths(self, number: int) -> Array:
        """Largest displacement of a marker by each force of 1 N, (d + K,), in m."""
        return np.asarray(np.abs(self._matrix[number]).max(axis=(0, 1)))

    def moved(self, number: int, forces: Array) -> Array:
        """Displacements of the markers of the linear body in m, (m, d), by (d + K,) in N."""
        return np.asarray(self._matrix[number] @ forces)

    def around(self, number: int) -> list[int]:
        """Numbers of neighbours."""
        count = min(NEIGHBOURS + 1, len(self.nodes))
        near = self._tree.query(self._places[number], count)[1]
        return list(map(int, np.atleast_1d(near)))

    def ranked(self, moved: Array) -> tuple[list[int], Array]:
        """Numbers of the first nodes, and the forces in N with which they fit, (FIRST, d + K)."""
        weights, floor = np.ones(self._matrix.shape[:2]), FLOOR * float(np.abs(moved).max())
        for _ in range(ROUNDS):
            rows = weights[:, :, None, None] * self._matrix
            normal = np.einsum("nmdp,nmdq->npq", rows, self._matrix)
            ridge = ROUNDING * np.trace(normal, axis1=1, axis2=2)
            normal += ridge[:, None, None] * np.eye(normal.shape[1])
            right = np.einsum("nmdp,md->np", rows, moved)
            found = np.linalg.solve(normal, right[..., None])[..., 0]
            fitted = np.einsum("nmdp,np->nmd", self._matrix, found)
            off = np.linalg.norm(moved - fitted, axis=2)
            weights = cauchy(off / np.sqrt(self._dimension), self._sigma, floor)
        noise = self._sigma or max(float(np.median(off, axis=1).min()), floor)
        first = np.argsort(np.log1p((off / noise) ** 2).sum(axis=1))[:FIRST]
        return list(map(int, first)), found[first]


@dataclass(frozen=True)
class Likely:
    """A node that the force may act on: its number among the places, fit and probability."""

    number: int
    fit: Fit
    share: float


def likely_places(
    places: Places, moved: Array, fitted: Callable[[int, Array], Fit], at: Callable[[Fit], Array]
) -> list[Likely]:
    """Fit predictions at the nodes that may bear the force; the most likely node first.

    Parameters
    ----------
    places : Places
    moved : array, (m, d)
        Displacements of the markers in m, without linear ones of known loads.
    fitted : callable
        A number of a place and forces in N to begin with, (d + K,) → fit; it may raise WorkError.
    at : callable
        A fit → predicted displacements of the markers in m, (m, d), without those of known loads.

    Raises
    ------
    WorkError
        If there is none.
    """
    fits: dict[int, Fit | None] = {}
    aim, best = moved, None
    for _ in range(RANKINGS):
        first, forces = places.ranked(aim)
        begins = dict(zip(first, forces, strict=True))
        if best is not None:
            count = forces.shape[1]
            near = fits[best]
            assert near is not None
            begins |= dict.fromkeys(places.around(best), near.theta[:count])
        new = {number: begin for number, begin in begins.items() if number not in fits}
        for number, begin in new.items():
            try:
                fits[number] = fitted(number, begin)
            except WorkError:
                fits[number] = None
        likely = shares(fits)
        if not likely or not new:
            break
        best = likely[0].number
        aim = moved - at(likely[0].fit) + places.moved(best, likely[0].fit.theta[: forces.shape[1]])
    likely = shares(fits)
    if not likely:
        raise WorkError("no place of a force is found that fits the markers")
    return likely


def shares(fits: dict[int, Fit | None]) -> list[Likely]:
    """Probabilities of fits by their sums of squares; wild markers count for a constant."""
    found = {number: fit for number, fit in fits.items() if fit is not None}
    if not found:
        return []
    sigma = min(fit.sigma for fit in found.values())
    costs = np.array([(np.minimum(fit.lengths / sigma, WILD) ** 2).sum() for fit in found.values()])
    share = np.exp(-(costs - costs.min()) / 2)
    likely = [
        Likely(number, fit, float(part))
        for (number, fit), part in zip(found.items(), share / share.sum(), strict=True)
    ]
    return sorted(likely, key=lambda one: -one.share)
