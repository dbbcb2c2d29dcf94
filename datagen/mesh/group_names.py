"""Named groups of nodes, those of points, curves, surfaces and volumes that have one name apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.groups import KINDS

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
