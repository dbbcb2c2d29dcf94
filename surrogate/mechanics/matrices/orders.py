"""Orders of the unknowns of a body in which its stiffness, or its factor, has little in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from surrogate.mechanics.matrices.cell_matrices import sum_of_cells

Array = NDArray[np.float64]


def band_order(
    coordinates: Array, cells: NDArray[np.int64], held: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], int]:
    """Order of the free degrees of freedom in which they form a narrow band, and its width.

    The free nodes are renumbered so that neighbours have near numbers: by the method of Cuthill and
    McKee (1969), reversed, or along the coordinate axis that gives a narrower band.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    held : array of bool, (n_nodes, m)
        Components that are no degrees of freedom; m is d for displacements, 1 for scalars.

    Returns
    -------
    dofs : array of int, (n,)
        Free degrees of freedom, node · m + component.
    width : int
        Number b of diagonals below the main one.
    """
    d, corners = held.shape[1], cells.shape[1]
    free = np.flatnonzero(~held.all(axis=1))
    graph = sum_of_cells(np.ones((len(cells), corners, corners)), cells, len(coordinates))
    graph = graph[free][:, free].tocoo()

    def distance(order: NDArray[np.int64]) -> int:
        """Largest distance of neighbours."""
        place = np.argsort(order)
        return int(np.abs(place[graph.row] - place[graph.col]).max(initial=0))

    axes = np.arange(coordinates.shape[1])
    places = np.round(coordinates[free] / np.ptp(coordinates, axis=0).max(), 9)  # equal ones tie
    orders = [np.lexsort(places[:, np.roll(axes, shift)].T) for shift in axes]
    order = min([reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True), *orders], key=distance)
    dofs = (free[order][:, None] * d + np.arange(d)).ravel()
    return dofs[~held.ravel()[dofs]], distance(order) * d + d - 1


def dofs_of_least_degree(cells: NDArray[np.int64], held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Free degrees of freedom, node · m + component, in an order of least degree."""
    dofs = np.where(held, -1, np.arange(held.size).reshape(held.shape))
    found = dofs[of_least_degree(cells, len(held))].ravel()
    return found[found >= 0]


def of_least_degree(cells: NDArray[np.int64], points: int) -> NDArray[np.int64]:
    """Order of the points that leaves few entries in factors of their graph."""
    size = cells.shape[1]
    graph = sum_of_cells(np.ones((len(cells), size, size)), cells, points)
    graph = graph + csc_array(diags(np.full(points, float(graph.sum()))))  # definite
    lu = splu(csc_array(graph), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(np.argsort(lu.perm_c))
