"""Uniform refinement of a mesh: every cell becomes four in the plane, eight in space.

New nodes are the middles of edges, and those of the faces and cells of quadrilaterals and
hexahedra. They lie in the cells of the coarse mesh: a curved surface keeps its facets.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.groups import facets_of_cells
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.groups import GroupParts, RawMesh
from shared_schema.common.bodies.reference_cells import CORNERS
from shared_schema.loads.regions import members_of

Numbers = NDArray[np.int64]
Corners = list[tuple[int, ...]]
TRIANGLES: Corners = [(0, 3, 4), (3, 1, 5), (4, 5, 2), (3, 5, 4)]
AT_CORNERS: Corners = [(0, 4, 5, 6), (4, 1, 7, 8), (5, 7, 2, 9), (6, 8, 9, 3)]
DIAGONALS = {(4, 9): (5, 7, 8, 6), (5, 8): (4, 6, 9, 7), (6, 7): (4, 5, 9, 8)}  # and what is around


def refined(mesh: RawMesh) -> RawMesh:
    """Divide every cell; the nodes of the mesh keep their numbers.

    Named groups hold the new nodes that `members_of` says, of those the ones that lie in a facet or
    cell of the group where its nodes do not tell these, and the parts of their facets and cells.
    """
    corners = len(CORNERS[mesh.cell_type])
    places, parts_of = _pattern(mesh.cell_type)
    wide = np.array([(place * corners)[:corners] for place in places])
    rows = _distinct_first(mesh.cells[:, wide].reshape(-1, corners))
    entities, numbers = np.unique(rows, axis=0, return_inverse=True)
    entities, order = _old_nodes_first(entities, len(mesh.coordinates))
    points = order[numbers.reshape(len(mesh.cells), len(places))]
    count = (entities != entities[:, :1]).sum(axis=1) + 1
    kept = np.arange(corners) < count[:, None]
    coordinates = (mesh.coordinates[entities] * kept[..., None]).sum(axis=1) / count[:, None]
    if mesh.cell_type == "tetra":
        children = _all_tetrahedra(coordinates[points])
        cells = np.take_along_axis(points, children.reshape(len(points), -1), axis=1)
    else:
        cells = points[:, np.array(parts_of).ravel()]
    cells = cells.reshape(-1, corners)
    parts = len(cells) // len(mesh.cells)
    on_surface = np.zeros(len(coordinates), dtype=bool)
    on_surface[boundary_facets(cells, mesh.cell_type)] = True
    groups = {
        name: np.flatnonzero(members_of(members, entities, on_surface))
        for name, members in mesh.node_sets.items()
    }
    cell_groups = {
        name: (parts * members[:, None] + np.arange(parts)).ravel()
        for name, members in mesh.cell_groups.items()
    }
    fine = facets_of_cells(cells, mesh.cell_type) if mesh.parts else cells[:0]
    refined_parts = {}
    for name, part in mesh.parts.items():
        sides = _within(part.facets, fine, entities)
        inside = (parts * part.cells[:, None] + np.arange(parts)).ravel()
        refined_parts[name] = GroupParts(sides, inside)
        kept = np.isin(groups[name], sides) | np.isin(groups[name], cells[inside])
        groups[name] = groups[name][kept | (groups[name] < len(mesh.coordinates))]
    origins = entities
    if mesh.origins is not None:
        origins = _distinct_first(mesh.origins[entities].reshape(len(entities), -1))[:, :corners]
    return replace(
        mesh,
        coordinates=coordinates,
        cells=cells,
        groups=groups,
        cell_groups=cell_groups,
        origins=origins,
        parts=refined_parts,
    )


def _within(facets: Numbers, fine: Numbers, origins: Numbers) -> Numbers:
    """Facets of a refined mesh that are parts of some facets of the coarse mesh.

    The coarse nodes that the nodes of a part come from are those of its facet.
    """
    known = {tuple(row) for row in facets.tolist()}
    near = fine[np.isin(origins[fine], facets).all(axis=(1, 2))]
    chosen = [tuple(np.unique(origins[row]).tolist()) in known for row in near]
    return near[np.array(chosen, dtype=bool)]


def _pattern(cell_type: str) -> tuple[Corners, Corners]:
    """Corners of the edge, face or cell of every point in a cell, corners first; its parts."""
    reference = CORNERS[cell_type]
    if cell_type in ("triangle", "tetra"):
        count = len(reference)
        places: Corners = [(c,) for c in range(count)]
        places += combinations(range(count), 2)
        return places, TRIANGLES if cell_type == "triangle" else AT_CORNERS
    axes = len(reference[0])
    lattice = [tuple(2 * x for x in corner) for corner in reference]
    lattice += [p for p in product(range(3), repeat=axes) if p not in lattice]
    places = [
        tuple(
            c
            for c, corner in enumerate(reference)
            if all(x in (1, 2 * y) for x, y in zip(point, corner, strict=True))
        )
        for point in lattice
    ]
    children: Corners = [
        tuple(lattice.index(tuple(map(sum, zip(start, c, strict=True)))) for c in reference)
        for start in product(range(2), repeat=axes)
    ]
    return places, children


def _all_tetrahedra(points: NDArray[np.float64]) -> Numbers:
    """Parts of tetrahedra, (n_cells, 8, 4): their octahedra are cut along the shortest diagonal."""
    lengths = [np.linalg.norm(points[:, a] - points[:, b], axis=1) for a, b in DIAGONALS]
    shortest = np.argmin(lengths, axis=0)
    kinds = []
    for (a, b), ring in DIAGONALS.items():
        inner = [(a, b, ring[k], ring[(k + 1) % 4]) for k in range(4)]
        kinds.append([*AT_CORNERS, *inner])
    return _upright(points, np.array(kinds)[shortest])


def _upright(points: NDArray[np.float64], parts: Numbers) -> Numbers:
    """The parts in the orientation of their cell, whichever that is."""
    x = points[np.arange(len(points))[:, None, None], parts]
    volumes = np.linalg.det(x[:, :, 1:] - x[:, :, :1])
    cell = np.linalg.det(points[:, 1:4] - points[:, :1])
    turned = volumes * cell[:, None] < 0
    found = parts.copy()
    found[turned] = parts[turned][:, [0, 1, 3, 2]]
    return found


def _distinct_first(rows: Numbers) -> Numbers:
    """Sorted rows with every number once, and then repeats of the first."""
    rows = np.sort(rows, axis=1)
    repeated = np.zeros(rows.shape, dtype=bool)
    repeated[:, 1:] = rows[:, 1:] == rows[:, :-1]
    order = np.argsort(repeated, axis=1, kind="stable")
    filled = np.where(repeated, rows[:, :1], rows)
    return np.take_along_axis(filled, order, axis=1)


def _old_nodes_first(entities: Numbers, count: int) -> tuple[Numbers, Numbers]:
    """Entities with the nodes of the coarse mesh first, by number; new number of each."""
    is_node = (entities == entities[:, :1]).all(axis=1)
    order = np.lexsort((np.where(is_node, entities[:, 0], 0), ~is_node))
    numbers = np.empty(len(entities), dtype=np.int64)
    numbers[order] = np.arange(len(entities))
    assert is_node.sum() == count  # every node of a mesh belongs to a cell
    return entities[order], numbers
