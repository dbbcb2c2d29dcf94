"""Named groups of nodes, facets and cells; those of points, curves, surfaces and volumes apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import FACETS, boundary_facets
from shared_schema.common.bodies.groups import KINDS, GroupParts, cells_in, facets_in

Ints = NDArray[np.int64]
Group = tuple[int, str]  # dimension and name
Blocks = Sequence[tuple[str, Ints]]  # cells of one type each: meshio's name, (n_cells, n_corners)
CellSets = Mapping[str, Sequence[Ints | None]]  # cells of every group, for each block in turn


def dimension_of(cell_type: str) -> int:
    """Dimension of a type of cells, by meshio's or gmsh's name."""
    kinds = {"vertex": 0, "point": 0, "line": 1, "triangle": 2, "quad": 2, "polygon": 2}
    return next((d for kind, d in kinds.items() if cell_type.lower().startswith(kind)), 3)


def nodes_of_cells(blocks: Blocks, cell_sets: CellSets) -> dict[Group, Ints]:
    """Nodes of every group of cells, those of each dimension apart."""
    found: dict[Group, Ints] = {}
    for name, members in cell_sets.items():
        for (cell_type, cells), chosen in zip(blocks, members, strict=True):
            if chosen is not None and len(chosen):
                group = dimension_of(cell_type), name
                nodes = cells[np.asarray(chosen, dtype=np.int64)].ravel()
                found[group] = np.union1d(found.get(group, nodes), nodes)
    return found


def by_name(groups: Mapping[Group, Ints]) -> dict[str, Ints]:
    """Groups by their names, or such as ``curve 1`` if unlike ones of several kinds have one name.

    Parameters
    ----------
    groups : mapping of (dimension, name) to array of int
        Nodes, ascending.
    """
    kinds: dict[str, list[int]] = {}
    for dimension, name in sorted(groups):
        kinds.setdefault(name, []).append(dimension)
    found = {}
    for name, dimensions in kinds.items():
        first = groups[dimensions[0], name]
        if all(np.array_equal(first, groups[each, name]) for each in dimensions):
            found[name] = first
        else:
            found |= {f"{KINDS[each]} {name}": groups[each, name] for each in dimensions}
    return found


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
