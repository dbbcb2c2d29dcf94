"""Facets and cells of named groups, of those whose nodes do not tell them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.group_names import Blocks, CellSets, dimension_of
from shared_schema.common.bodies.cells import FACETS, boundary_facets
from shared_schema.common.bodies.groups import KINDS, GroupParts, cells_in, facets_in

Ints = NDArray[np.int64]


def parts_of_groups(
    blocks: Blocks,
    cell_sets: CellSets,
    number: Ints,
    cells: Ints,
    cell_type: str,
    groups: Mapping[str, Ints],
    cell_groups: Mapping[str, Ints],
) -> dict[str, GroupParts]:
    """Find the groups whose nodes are also all those of other facets or cells, and what they hold.

    Groups of nodes alone hold all facets and cells of these nodes; so do groups of cells and of
    facets that have one name and the same nodes.

    Parameters
    ----------
    blocks, cell_sets
        As for `datagen.mesh.raw_mesh.raw_mesh`.
    number : array of int, (n_points,)
        Number of every point of the blocks as a node, -1 for those that are none.
    cells : array of int, (n_cells, n_corners)
        Node numbers of the cells of the mesh.
    cell_type : str
    groups, cell_groups : mapping of str to array of int
        Nodes and cells of the named groups of the mesh.
    """
    surface, dimension = boundary_facets(cells, cell_type), dimension_of(cell_type)
    corners, found = surface.shape[1], {}
    for name, members in cell_sets.items():
        rows: dict[int, list[Ints]] = {}
        for (kind, elements), chosen in zip(blocks, members, strict=True):
            if chosen is not None and len(chosen) and dimension_of(kind) > 0:
                nodes = number[elements[np.asarray(chosen, dtype=np.int64)]]
                rows.setdefault(dimension_of(kind), []).append(nodes)
        for each, nodes_of in rows.items():
            full = name if name in groups else f"{KINDS[each]} {name}"
            if full not in groups or (full == name and len(rows) > 1):
                continue
            inside = np.empty(0, dtype=np.int64)
            sides = np.empty((0, corners), dtype=np.int64)
            if each == dimension:
                inside = cell_groups[name]
                sides = facets_of_cells(cells[inside], cell_type)
            elif each == dimension - 1:
                first = [r[:, :corners] for r in nodes_of if r.shape[1] >= corners]
                sides = np.concatenate([sides, *first])
                sides = np.unique(np.sort(sides[(sides >= 0).all(axis=1)], axis=1), axis=0)
            part = GroupParts(sides, inside)
            mask = np.zeros(number.max() + 1, dtype=bool)
            mask[groups[full]] = True
            by_nodes = np.flatnonzero(cells_in(cells, mask, None))
            if not part.hold(facets_in(surface, mask, None)).all() or not np.array_equal(
                by_nodes, inside
            ):
                found[full] = part
    return found


def facets_of_cells(cells: Ints, cell_type: str) -> Ints:
    """All facets of cells by their nodes, ascending, each once: (n_facets, n_facet_corners)."""
    rows = np.concatenate([cells[:, facet] for facet in FACETS[cell_type]])
    return np.unique(np.sort(rows, axis=1), axis=0)
