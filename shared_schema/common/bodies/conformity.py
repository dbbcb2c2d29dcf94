"""What the cells of a mesh must be: each once, and two at most, on opposite sides, at a facet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shared_schema.common.bodies.cells import FACETS, NEIGHBOURS, is_turned

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
