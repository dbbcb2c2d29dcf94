r"""The node of the surface that a single force acts on, from what markers tell.

Under small displacements the markers move by :math:`A_a g` under a force g on node a, with columns
of :math:`K^{-1}` at the markers, which are those of unit forces at the markers
(:math:`K^{-1}` is symmetric). Nodes are ranked by the robust sum of squares that is left. From the
best one, the search goes on to neighbours as long as the nonlinear fit becomes better there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from shared_schema.common.errors import WorkError
from surrogate.identification.least_squares import FLOOR, WILD, Fit, cauchy
from surrogate.identification.responses import Body

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

ROUNDS = 6  # of weights
ROUNDING = 1e-12
NEIGHBOURS = 8  # nodes that are tried around the best one
STARTS = 2  # nodes from which the search goes on
MOST = 60  # nodes that are tried at all


@dataclass(frozen=True)
class Ranking:
    """Nodes of the surface, the most likely first.

    Attributes
    ----------
    nodes : array of int, (n,)
    forces : array, (n, d)
        On them in N, under which the linear body fits the markers best.
    strengths : array, (n, d)
        Largest displacement of a marker by 1 N along each axis, in m.
    """

    nodes: Numbers
    forces: Array
    strengths: Array


def ranked_nodes(
    body: Body, at_markers: csr_array, moved: Array, beside: Array, sigma: float | None
) -> Ranking:
    """Rank the nodes by how well a force there explains the markers.

    Parameters
    ----------
    body : Surrogate
    at_markers : csr_array, (m, n_nodes)
    moved : array, (m, d)
        Displacements in m, without the linear ones of known loads.
    beside : array, (m, d, K)
        Linear displacements of other sought forces of 1 N.
    sigma : float, optional
        Noise of a component in m.
    """
    geometry = body.geometry
    nodes = geometry.surface_nodes[geometry.free[geometry.surface_nodes].all(axis=1)]
    m, d = moved.shape
    unit = np.zeros((m, d, *geometry.coordinates.shape))
    for axis in range(d):
        unit[:, axis, :, axis] = at_markers.toarray()
    columns = body.equilibrium.linear_response(unit.reshape(m * d, *geometry.coordinates.shape))
    of_nodes = np.moveaxis(columns[:, nodes], 1, 0).reshape(len(nodes), m, d, d)
    others = np.broadcast_to(beside, (len(nodes), *beside.shape))
    matrix = np.concatenate([of_nodes, others], axis=-1)  # (n, m, d, d + K)
    weights, floor = np.ones((len(nodes), m)), FLOOR * float(np.abs(moved).max())
    for _ in range(ROUNDS):
        rows = weights[:, :, None, None] * matrix
        normal = np.einsum("nmdp,nmdq->npq", rows, matrix)
        ridge = ROUNDING * np.trace(normal, axis1=1, axis2=2)
        normal += ridge[:, None, None] * np.eye(normal.shape[1])
        right = np.einsum("nmdp,md->np", rows, moved)
        found = np.linalg.solve(normal, right[..., None])[..., 0]
        off = np.linalg.norm(moved - np.einsum("nmdp,np->nmd", matrix, found), axis=2)
        weights = cauchy(off / np.sqrt(d), sigma, floor)
    noise = sigma or max(float(np.median(off, axis=1).min()), floor)
    order = np.argsort(np.log1p((off / noise) ** 2).sum(axis=1))
    strengths = np.abs(of_nodes).max(axis=(1, 2))
    return Ranking(nodes[order], found[order, :d], strengths[order])


def likely_nodes(
    coordinates: Array, ranked: Numbers, fitted: Callable[[int, Fit | None], Fit]
) -> tuple[list[Fit], Numbers, Array]:
    """Fits at the nodes that were tried, from the first ones on to better neighbours.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
    ranked : array of int
        Nodes, the most likely first.
    fitted : callable
        A node, and a fit at another one to begin with → its fit; it may raise WorkError.

    Returns
    -------
    list of Fit, array of int (n,), array (n,)
        Fits, their nodes and probabilities, the most likely first.

    Raises
    ------
    WorkError
        If there is none.
    """
    tree, tried = cKDTree(coordinates[ranked]), dict[int, Fit | None]()

    def attempt(node: int, near: Fit | None) -> None:
        if node not in tried and len(tried) < MOST:
            try:
                tried[node] = fitted(node, near)
            except WorkError:
                tried[node] = None

    def best() -> int | None:
        found = {node: fit for node, fit in tried.items() if fit is not None}
        if not found:
            return None
        return list(found)[int(np.argmin(misfits(list(found.values()))))]

    for start in ranked[:STARTS].tolist():
        attempt(start, None)
        while (node := best()) is not None:
            near = tree.query(coordinates[node], k=min(NEIGHBOURS + 1, len(ranked)))[1]
            for neighbour in ranked[np.atleast_1d(near)].tolist():
                attempt(neighbour, tried[node])
            if best() == node:
                break
    nodes = np.array([node for node, fit in tried.items() if fit is not None], np.int64)
    fits = [fit for fit in tried.values() if fit is not None]
    if not fits:
        raise WorkError("no place of a force is found that fits the markers")
    costs = misfits(fits)
    order = np.argsort(costs)
    probability = np.exp(-(costs[order] - costs.min()) / 2)
    return [fits[i] for i in order], nodes[order], probability / probability.sum()


def misfits(fits: list[Fit]) -> Array:
    """Sums of squares over the variance of the best fit; wild markers count for a constant."""
    sigma = min(fit.sigma for fit in fits)
    return np.array([(np.minimum(fit.lengths / sigma, WILD) ** 2).sum() for fit in fits])
