r"""Cells that lie over others without sharing a facet with them, and places where a body is split.

In a mesh whose neighbours lie on opposite sides of their facets, the number of cells that cover a
point changes only at the boundary. Where it is two or more, some cell at the boundary overlaps
another one. So it is enough to hold the cells at the boundary against those near them.

Cells are divided into simplices, hexahedra about the centres of faces and cell. Two simplices are
apart if some direction separates them: a normal of their faces or a product of two of their edges
(Gottschalk et al., OBBTree, SIGGRAPH 1996). Parts that touch are apart.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shared_schema.common.bodies.cells import FACETS, boundary_facets, cell_names
from shared_schema.common.bodies.nodal_forces import COINCIDENT

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
TOUCHING = 1e-3  # depth of an overlap that counts as touching, over the shorter longest edge
CHUNK = 256  # simplices at the boundary that are looked at together


def overlap_problem(coordinates: Array, cells: Ints, cell_type: str) -> str | None:
    """Say which cells lie over others; None if none do.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Cells without a `conformity_problem`.
    cell_type : str

    Returns
    -------
    str or None
        One line that names cells by their number, from 0.
    """
    corners, parent, outer = _simplices(coordinates, cells, cell_type)
    found = [
        np.stack([parent[some], parent[others]], axis=1)[_overlap(corners[some], corners[others])]
        for some, others in near_pairs(corners, parent, outer)
    ]
    pairs = np.concatenate([np.empty((0, 2), dtype=np.int64), *found])
    shared = (cells[pairs[:, 0]][:, :, None] == cells[pairs[:, 1]][:, None]).sum(axis=(1, 2))
    pairs = pairs[shared < len(FACETS[cell_type][0])]  # neighbours at a facet are apart
    if not len(pairs):
        return None
    first, second = min(sorted(pair) for pair in pairs.tolist())
    at = ",".join(f"{x:g}" for x in coordinates[cells[first]].mean(axis=0))
    return (
        f"{cell_names(np.unique(pairs))}: they overlap (cell {first} at {at} lies over cell "
        f"{second}), expected cells that only touch"
    )


def _simplices(
    coordinates: Array, cells: Ints, cell_type: str
) -> tuple[Array, Ints, NDArray[np.bool_]]:
    """Corners of simplices, (n, d + 1, d); their cells; and whether they are at the boundary."""
    x, count = coordinates[cells], len(cells)
    at_boundary = _boundary(cells, cell_type)
    if cell_type in ("triangle", "tetra"):
        return x, np.arange(count), np.asarray(at_boundary.any(axis=1))
    if cell_type == "quad":
        halves = np.stack([x[:, [0, 1, 2]], x[:, [0, 2, 3]]], axis=1).reshape(-1, 3, 2)
        return halves, np.repeat(np.arange(count), 2), np.repeat(at_boundary.any(axis=1), 2)
    faces = FACETS[cell_type]
    parts = np.empty((count, len(faces), 4, 4, 3))
    parts[..., 3, :] = x.mean(axis=1)[:, None, None]
    for number, face in enumerate(faces):
        on = x[:, list(face)]
        parts[:, number, :, 0], parts[:, number, :, 1] = on, np.roll(on, -1, axis=1)
        parts[:, number, :, 2] = on.mean(axis=1)[:, None]
    outer = np.repeat(at_boundary.ravel(), 4)
    return parts.reshape(-1, 4, 3), np.repeat(np.arange(count), 4 * len(faces)), outer


def _boundary(cells: Ints, cell_type: str) -> NDArray[np.bool_]:
    """Facets of cells that belong to no other cell: (n_cells, n_facets)."""
    ordered = np.sort(boundary_facets(cells, cell_type), axis=1)
    every = np.sort(np.stack([cells[:, f] for f in FACETS[cell_type]], axis=1), axis=2)
    rows = np.concatenate([ordered, every.reshape(-1, every.shape[2])])
    number = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    return np.isin(number[len(ordered) :], number[: len(ordered)]).reshape(every.shape[:2])


def near_pairs(
    corners: Array, parent: Ints, outer: NDArray[np.bool_]
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs of simplices of two cells, the first at the boundary, whose bounding boxes overlap.

    Parameters
    ----------
    corners : array, (n, n_corners, d)
        In m.
    parent : array of int, (n,)
        Cell of each simplex.
    outer : array of bool, (n,)
        Simplices at the boundary.

    Yields
    ------
    some, others : array of int, (n_pairs,)
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    centre, radius = (low + high) / 2, np.linalg.norm(high - low, axis=1) / 2
    queries = np.flatnonzero(outer)
    octave = np.floor(np.log2(radius)).astype(int)
    for size in np.unique(octave):  # of a tree, so that large cells do not widen all searches
        members = np.flatnonzero(octave == size)
        tree, reach = cKDTree(centre[members]), radius[members].max()
        for start in range(0, len(queries), CHUNK):
            asked = queries[start : start + CHUNK]
            lists = tree.query_ball_point(centre[asked], radius[asked] + reach)
            counts = np.array([len(each) for each in lists])
            if not counts.any():
                continue
            some = np.repeat(asked, counts)
            others = members[np.concatenate([np.asarray(each, dtype=int) for each in lists])]
            meet = (low[some] < high[others]).all(axis=1) & (low[others] < high[some]).all(axis=1)
            meet &= parent[some] != parent[others]
            yield some[meet], others[meet]


def _overlap(some: Array, others: Array) -> NDArray[np.bool_]:
    """Pairs of simplices, (n, d + 1, d) each, that no direction separates: (n,)."""
    edges_of, d = _edges, some.shape[2]
    first, second = edges_of(some), edges_of(others)
    lengths = [np.linalg.norm(e, axis=2).max(axis=1) for e in (first, second)]
    touching = TOUCHING * np.minimum(*lengths)
    left = np.arange(len(some))
    if d == 2:
        axes = [np.stack([-e[:, :, 1], e[:, :, 0]], axis=2) for e in (first, second)]
        return _not_apart(some, others, np.concatenate(axes, axis=1), touching)
    apart = np.ones(len(some), dtype=bool)
    normals = np.concatenate([_normals(some), _normals(others)], axis=1)
    left = np.flatnonzero(_not_apart(some, others, normals, touching))
    products = np.cross(first[left][:, :, None], second[left][:, None]).reshape(len(left), 36, 3)
    apart[left] = ~_not_apart(some[left], others[left], products, touching[left])
    return ~apart


def _edges(corners: Array) -> Array:
    pairs = np.array([(i, j) for i in range(corners.shape[1]) for j in range(i)])
    return np.asarray(corners[:, pairs[:, 0]] - corners[:, pairs[:, 1]])


def _normals(corners: Array) -> Array:
    """Normals of the faces of tetrahedra, of any length: (n, 4, 3)."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    faces = ((a, b, c), (a, b, d), (a, c, d), (b, c, d))
    return np.stack([np.cross(q - p, r - p) for p, q, r in faces], axis=1)


def _not_apart(some: Array, others: Array, axes: Array, touching: Array) -> NDArray[np.bool_]:
    """Pairs whose projections on all axes, (n, n_axes, d), overlap by more than `touching`."""
    length = np.linalg.norm(axes, axis=2)
    a, b = np.einsum("nad,ncd->nac", axes, some), np.einsum("nad,ncd->nac", axes, others)
    depth = np.minimum(a.max(axis=2), b.max(axis=2)) - np.maximum(a.min(axis=2), b.min(axis=2))
    parallel = length <= 1e-9 * length.max(axis=1, keepdims=True)
    return np.asarray(((depth > touching[:, None] * length) | parallel).all(axis=1))


def split_warning(coordinates: NDArray[np.float64]) -> str | None:
    """Say where parts of a body touch and share no nodes, (n_nodes, d) in m; None if nowhere.

    Programs that mesh each part for itself leave the nodes between them twice, where a body would
    be torn; a crack is meant so.
    """
    distance = COINCIDENT * float(np.ptp(coordinates, axis=0).max())
    pairs = cKDTree(coordinates).query_pairs(distance, output_type="ndarray")
    if not len(pairs):
        return None
    at = ",".join(f"{value:g}" for value in coordinates[pairs.min()])
    return (
        f"{len(np.unique(pairs))} nodes share their places with others, the first at {at}: the "
        "body is split there, expected parts that share their nodes if it is no crack"
    )
