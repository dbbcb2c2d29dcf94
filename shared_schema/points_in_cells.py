"""Points in the cells of a mesh: the cell that each lies in, and interpolation there.

Nearest points are found in a k-d tree, also with denormal numbers flushed to zero. SciPy splits
points that share their least coordinate at the next number above. Next to 0 this is a denormal one;
where a program flushes such numbers to zero, as the learner's commands do, the tree splits without
end. So the points are moved away from 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from shared_schema.common.bodies.reference_cells import shape_gradients, shape_values

Array = NDArray[np.float64]


class PointTree:
    """Points, to be found by their distance.

    Parameters
    ----------
    points : array, (n, d)
    """

    def __init__(self, points: Array) -> None:
        lowest, highest = points.min(axis=0), points.max(axis=0)
        self._shift = float((highest - lowest).max()) - lowest
        self._tree = KDTree(points + self._shift)

    def query(self, x: Array, k: int = 1) -> tuple[Any, Any]:
        """Distances and numbers of the k nearest points: (m, d) → (m,) or (m, k) each."""
        return self._tree.query(x + self._shift, k)

    def query_ball_point(self, x: Array, radius: Array) -> NDArray[np.object_]:
        """Numbers of all points within a radius: (m, d) and (m,) → lists, (m,)."""
        found: NDArray[np.object_] = self._tree.query_ball_point(x + self._shift, radius)
        return found


CANDIDATES = 24  # cells looked at for each point, those with the nearest centres
AT_ONCE = 1000  # positions
NEWTON_STEPS = 8  # of the search for reference coordinates; simplices need one
ROUNDING = 1e-9


def locate(
    positions: Array, coordinates: Array, cells: NDArray[np.int64], cell_type: str
) -> tuple[NDArray[np.intp], Array, Array]:
    """Find the element that each position lies in or is nearest to, and its interpolation there.

    Parameters
    ----------
    positions : array, (n, d)
        In m.
    coordinates, cells, cell_type
        The mesh.

    Returns
    -------
    cell : array of int, (n,)
    weights : array, (n, n_corners)
        Weights of the element's nodes; outside of it those of the linear continuation.
    outside : array, (n,)
        Distance outside of the element, relative to its size; 0 inside.
    """
    corners = coordinates[cells]
    size = np.ptp(corners, axis=1).max(axis=1)
    tree = PointTree(corners.mean(axis=1))
    count = min(CANDIDATES, len(cells))
    candidates = np.asarray(tree.query(positions, k=count)[1]).reshape(len(positions), count)
    cell = np.empty(len(positions), dtype=np.intp)
    weights, outside = np.empty((len(positions), cells.shape[1])), np.empty(len(positions))
    for start in range(0, len(positions), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        each, rows = np.repeat(positions[some], count, axis=0), np.arange(len(positions[some]))
        shares, off = interpolation(each, corners[candidates[some].ravel()], cell_type)
        off = off.reshape(-1, count)
        nearest = (off * size[candidates[some]]).argmin(axis=1)
        cell[some], outside[some] = candidates[some][rows, nearest], off[rows, nearest]
        weights[some] = shares.reshape(*off.shape, -1)[rows, nearest]
    return cell, weights, outside


def interpolation(positions: Array, corners: Array, cell_type: str) -> tuple[Array, Array]:
    """Weights of an element's nodes at a position, continued linearly outside.

    The reference coordinates ξ solve x(ξ) = Σ N_a(ξ) x_a = x. Outside, the weights are those at
    the nearest ξ* of the element and of the gradient there, N(ξ*) + ∇N(ξ*) · (x − x(ξ*)).

    Parameters
    ----------
    positions : array, (n, d)
        In m.
    corners : array, (n, n_corners, d)
        Corners of one element for each position, in m.

    Returns
    -------
    weights : array, (n, n_corners)
    outside : array, (n,)
        Largest reference coordinate outside of the element; 0 inside.
    """
    is_simplex = cell_type in ("triangle", "tetra")
    xi = np.full(positions.shape, 0.25 if is_simplex else 0.5)
    for _ in range(1 if is_simplex else NEWTON_STEPS):
        value, gradient = shape_values(cell_type, xi), shape_gradients(cell_type, xi)
        jacobian = np.einsum("nca,ncb->nab", corners, gradient)
        residual = positions - np.einsum("nc,ncd->nd", value, corners)
        xi = xi + np.linalg.solve(jacobian, residual[..., None])[..., 0]
        if not is_simplex:
            xi = np.clip(xi, -1.0, 2.0)
    if is_simplex:
        outside = np.maximum(-xi.min(axis=1), xi.sum(axis=1) - 1)
    else:
        outside = np.abs(xi - 0.5).max(axis=1) - 0.5
        xi = np.clip(xi, 0.0, 1.0)
    value, gradient = shape_values(cell_type, xi), shape_gradients(cell_type, xi)
    jacobian = np.einsum("nca,ncb->nab", corners, gradient)
    rest = positions - np.einsum("nc,ncd->nd", value, corners)
    step = np.linalg.solve(jacobian, rest[..., None])[..., 0]
    return value + np.einsum("nca,na->nc", gradient, step), np.maximum(outside, 0.0)
