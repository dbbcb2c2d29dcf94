"""Cells of a mesh by meshio's names: their facets, its boundary, parts and sharp edges.

Each cell must be there once, and two at most, on opposite sides, at a facet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
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


def scaled_jacobians(
    coordinates: NDArray[np.float64], cells: NDArray[np.int64], cell_type: str
) -> NDArray[np.float64]:
    """Determinants of the d edges that meet at each corner, over their lengths: −1 to 1.

    The result is (n_cells, n_corners); it is 0 where an edge has no length.
    """
    corners, found = coordinates[cells], []
    for corner, neighbours in enumerate(NEIGHBOURS[cell_type]):
        edges = corners[:, list(neighbours)] - corners[:, [corner]]
        lengths = np.linalg.norm(edges, axis=2).prod(axis=1)
        found.append(np.linalg.det(edges) / np.where(lengths > 0, lengths, 1.0))
    return np.stack(found, axis=1)


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


SMOOTH = np.cos(np.radians(30))  # faces at a larger angle meet in a sharp edge


def edges_of(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges of all faces, going round each of them: (n, corners) → (n · corners, 2)."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def smooth_pairs(coordinates: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find the pairs of equal edges whose two faces meet at 30° at most; in the plane, all pairs.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    faces : array of int, (n_faces, n_corners)
        Node numbers, in space going round each face as seen from outside.

    Returns
    -------
    array of int, (n_pairs, 2)
        Rows of `edges_of`.
    """
    around = np.sort(edges_of(faces), axis=1)
    _, number, count = np.unique(around, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    order: NDArray[np.int64] = np.argsort(number, kind="stable")
    order = order[count[number[order]] == 2].reshape(-1, 2)
    if coordinates.shape[1] == 2:
        return order
    x = coordinates[faces]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    of_edge = order // faces.shape[1]
    cosine = np.einsum("ij,ij->i", normal[of_edge[:, 0]], normal[of_edge[:, 1]])
    return np.asarray(order[cosine >= SMOOTH])


def sharp_edges(coordinates: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges, each once, at which a surface turns by more than 30° or ends: (n_edges, 2)."""
    around = np.sort(edges_of(faces), axis=1)
    lines, smooth = np.unique(around, axis=0), around[smooth_pairs(coordinates, faces)[:, 0]]
    size = int(lines.max()) + 1
    return lines[~np.isin(lines @ [size, 1], smooth @ [size, 1])]


Ints = NDArray[np.int64]
NAMED = 6  # cells that a message names


def conformity_problem(coordinates: NDArray[np.float64], cells: Ints, cell_type: str) -> str | None:
    """Say what is wrong with the connections of cells; None if nothing is.

    Cells may be numbered in either direction (they count as turned): two that share a facet must
    lie on opposite sides of it. A cell that a moved node has turned over lies on that of its
    neighbour.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        meshio's name.

    Returns
    -------
    str or None
        One line that names cells by their number, from 0.
    """
    if not len(cells):
        return "no cells, expected some"
    corners = NEIGHBOURS.get(cell_type, ())
    found = cells.shape[1:], coordinates.shape[1:]
    if not corners or found != ((len(corners),), (len(corners[0]),)):
        return (
            f"cells of type '{cell_type}' with {cells.shape[1]} nodes in {found[1][0]} dimensions"
        )
    problem = node_problem(cells, len(coordinates))
    if problem is not None:
        return problem
    groups, number = _groups(np.sort(cells, axis=1))
    if len(groups) < len(cells):
        several = np.bincount(number)[number] > 1
        return f"{cell_names(several)}: the same nodes, expected each cell once"
    facets = np.concatenate([cells[:, facet] for facet in FACETS[cell_type]])
    of_cell = np.tile(np.arange(len(cells)), len(FACETS[cell_type]))
    _, number = _groups(np.sort(facets, axis=1))
    uses = np.bincount(number)
    crowded = uses[number] > 2
    if crowded.any():
        meeting = cell_names(of_cell[number == number[crowded.argmax()]])
        return (
            f"{cell_names(np.unique(of_cell[crowded]))}: more than two share a facet (at the "
            f"first, {meeting}), expected two at most"
        )
    turned = is_turned(coordinates, cells, cell_type)
    both = np.bincount(number, weights=_direction(facets) ^ turned[of_cell])
    wrong = (uses[number] == 2) & (both[number] != 1)
    if not wrong.any():
        return None
    bad = np.unique(of_cell[wrong])
    fewer = bad[turned[bad] if turned.mean() <= 0.5 else ~turned[bad]]
    return (
        f"{cell_names(fewer if fewer.size else bad)}: turned over, on the same side of a facet as "
        "the neighbour there, expected the opposite side"
    )


def node_problem(cells: Ints, count: int) -> str | None:
    """Say which cells name a node outside 0 … count − 1, or one twice; None if none do."""
    outside = ((cells < 0) | (cells >= count)).any(axis=1)
    if outside.any():
        return f"{cell_names(outside)}: a node outside 0 … {count - 1}"
    ordered = np.sort(cells, axis=1)
    repeated = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if repeated.any():
        return f"{cell_names(repeated)}: a node twice, expected {cells.shape[1]} different ones"
    return None


def cell_names(cells: ArrayLike) -> str:
    """Name some cells by number: ``cells 3, 7``, of many the first ones and how many there are."""
    numbers = np.asarray(cells)
    numbers = np.flatnonzero(numbers) if numbers.dtype == bool else numbers
    listed = ", ".join(map(str, numbers[:NAMED]))
    if len(numbers) > NAMED:
        return f"{len(numbers)} cells ({listed}, …)"
    return f"cell{'s' if len(numbers) > 1 else ''} {listed}"


def _groups(rows: Ints) -> tuple[Ints, Ints]:
    """First of each set of equal rows, and the number of the set of every row."""
    order = np.lexsort(rows.T)
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return order[new], number


def _direction(facets: Ints) -> NDArray[np.bool_]:
    """One of the two directions in which the corners of a facet are gone through: (n_facets,)."""
    count = facets.shape[1]
    rows, first = np.arange(len(facets)), facets.argmin(axis=1)
    if count == 2:
        return np.asarray(first == 0)
    after, before = facets[rows, (first + 1) % count], facets[rows, (first - 1) % count]
    return np.asarray(after < before)
