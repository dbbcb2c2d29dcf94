"""Cells by meshio's names: facets, neighbours of a corner; boundary and parts of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

FACETS = {  # corners of each facet of a cell, going round; in space as seen from outside
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
}
CELL_TYPES = tuple(FACETS)
NEIGHBOURS = {  # corners at the other ends of the edges at each corner, in a right-handed order
    "triangle": ((1, 2), (2, 0), (0, 1)),
    "quad": ((1, 3), (2, 0), (3, 1), (0, 2)),
    "tetra": ((1, 2, 3), (2, 0, 3), (0, 1, 3), (1, 0, 2)),
    "hexahedron": (
        (1, 3, 4),
        (2, 0, 5),
        (3, 1, 6),
        (0, 2, 7),
        (7, 5, 0),
        (4, 6, 1),
        (5, 7, 2),
        (6, 4, 3),
    ),
}


def boundary_facets(cells: NDArray[np.int64], cell_type: str) -> NDArray[np.int64]:
    """Find the facets that belong to one cell only.

    Parameters
    ----------
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str

    Returns
    -------
    array of int, (n_facets, n_facet_corners)
        Node numbers, going round each facet, in space as seen from outside.
    """
    return _of_one_cell(np.concatenate([cells[:, facet] for facet in FACETS[cell_type]]))


def outward_facets(
    coordinates: NDArray[np.float64], cells: NDArray[np.int64], cell_type: str
) -> NDArray[np.int64]:
    """Find the facets that belong to one cell only, going round each as seen from outside.

    In the plane the body is on the left. Cells may be numbered in either direction.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str

    Returns
    -------
    array of int, (n_facets, n_facet_corners)
    """
    turned = is_turned(coordinates, cells, cell_type)[:, None]
    facets = [cells[:, facet] for facet in FACETS[cell_type]]
    return _of_one_cell(np.concatenate([np.where(turned, f[:, ::-1], f) for f in facets]))


def is_turned(
    coordinates: NDArray[np.float64], cells: NDArray[np.int64], cell_type: str
) -> NDArray[np.bool_]:
    """Cells whose nodes are numbered against VTK's order, by the first corner: (n_cells,)."""
    neighbours = coordinates[cells[:, list(NEIGHBOURS[cell_type][0])]]
    return np.asarray(np.linalg.det(neighbours - coordinates[cells[:, [0]]]) < 0)


def _of_one_cell(facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Facets that occur once, whatever the order of their corners."""
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(facets[np.sort(first[count == 1])])


def parts_of(cells: NDArray[np.int64], cell_type: str) -> NDArray[np.int64]:
    """Number of the part that each cell belongs to, cells of which are connected by facets."""
    facets = np.concatenate([np.sort(cells[:, facet], axis=1) for facet in FACETS[cell_type]])
    of_cell = np.tile(np.arange(len(cells)), len(FACETS[cell_type]))
    order = np.lexsort(facets.T)
    same = (facets[order[1:]] == facets[order[:-1]]).all(axis=1)
    return components(of_cell[order[1:][same]], of_cell[order[:-1][same]], len(cells))


def components(some: NDArray[np.int64], others: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Number of the connected component of each of some things, of which pairs are connected."""
    pairs = coo_array((np.ones(len(some)), (some, others)), shape=(count, count))
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.int64)
