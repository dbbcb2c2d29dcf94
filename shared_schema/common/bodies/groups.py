"""A mesh as plain arrays, with named groups: their nodes, and their facets and cells.

A facet or a cell whose nodes all belong to a group need not belong to it: both faces of a plate
that is one cell thick have the nodes of its rim, and those of all its cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import hold_read_only
from shared_schema.common.bodies.cells import boundary_facets

if TYPE_CHECKING:
    from shared_schema.common.bodies.shape_family import ShapeFamily

Arrays = dict[str, NDArray[Any]]
Ints = NDArray[np.int64]
Nodes = Mapping[str, NDArray[np.bool_]]
KINDS = ("point", "curve", "surface", "volume")  # of groups, by their dimension


@dataclass(frozen=True)
class GroupParts:
    """Facets and cells of a group. The arrays are read-only.

    Attributes
    ----------
    facets : array of int, (n_facets, n_facet_corners)
        Numbers of their nodes, ascending; facets inside the body may be among them.
    cells : array of int, (n_parts,)
        Numbers of cells, ascending.
    """

    facets: NDArray[np.int64]
    cells: NDArray[np.int64]

    def __post_init__(self) -> None:
        hold_read_only(self)

    def hold(self, facets: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which facets, (n, n_facet_corners) by their nodes in any order, are among them: (n,)."""
        known = {row.tobytes() for row in self.facets.astype(np.int64)}
        rows = np.sort(facets, axis=1).astype(np.int64)
        return np.array([row.tobytes() in known for row in rows], dtype=bool)


def facets_in(
    surface: NDArray[np.int64], members: NDArray[np.bool_], parts: GroupParts | None
) -> NDArray[np.int64]:
    """Facets of a group among those of the surface: by its nodes, (n_nodes,), unless parts say."""
    found = surface[members[surface].all(axis=1)]
    return found if parts is None else found[parts.hold(found)]


def cells_in(
    cells: NDArray[np.int64], members: NDArray[np.bool_], parts: GroupParts | None
) -> NDArray[np.bool_]:
    """Which cells are those of a group, (n_cells,): by its nodes, (n_nodes,), unless parts say."""
    if parts is None:
        return np.asarray(members[cells].all(axis=1))
    found = np.zeros(len(cells), dtype=bool)
    found[parts.cells] = True
    return found


def groups_of(arrays: Arrays) -> dict[str, NDArray[np.bool_]]:
    """Nodes of every named group of a shard's mesh, (n_nodes,) each; none in older datasets."""
    if "mesh/groups" not in arrays:
        return {}
    names = [str(name) for name in arrays["mesh/group_names"]]
    return dict(zip(names, arrays["mesh/groups"], strict=True))


def parts_of(arrays: Arrays, cell_type: str) -> dict[str, GroupParts]:
    """Facets and cells of every named group of a shard's mesh; none where the nodes tell them."""
    if "mesh/group_facets" not in arrays:
        return {}
    surface = ordered_surface(arrays["mesh/cells"], cell_type)
    rows = zip(
        *(arrays[f"mesh/group_{name}"] for name in ("names", "facets", "cells")), strict=True
    )
    return {
        str(name): GroupParts(surface[facets], np.flatnonzero(cells))
        for name, facets, cells in rows
    }


def group_arrays(
    groups: Nodes,
    cells: NDArray[np.int64],
    cell_type: str,
    parts: Mapping[str, GroupParts] = MappingProxyType({}),
) -> Arrays:
    """Arrays of named groups by their paths in a shard; none if there are no groups.

    Parameters
    ----------
    groups : mapping of str to array of bool, (n_nodes,)
    cells : array of int, (n_cells, n_corners)
    cell_type : str
    parts : mapping of str to GroupParts
        Of the groups whose nodes do not tell their facets and cells.
    """
    if not groups:
        return {}
    names = sorted(groups)
    arrays: Arrays = {
        "mesh/group_names": np.array(names, dtype=object),
        "mesh/groups": np.stack([groups[name] for name in names]),
    }
    if parts:
        surface, every = ordered_surface(cells, cell_type), [parts.get(name) for name in names]
        facets, inside = [], []
        for name, part in zip(names, every, strict=True):
            mine = groups[name][surface].all(axis=1)
            facets.append(mine if part is None else mine & part.hold(surface))
            inside.append(cells_in(cells, groups[name], part))
        arrays |= {"mesh/group_facets": np.stack(facets), "mesh/group_cells": np.stack(inside)}
    return arrays


def ordered_surface(cells: NDArray[np.int64], cell_type: str) -> NDArray[np.int64]:
    """Facets of the surface by their nodes, ascending, in lexicographic order."""
    return np.unique(np.sort(boundary_facets(cells, cell_type), axis=1), axis=0)


def groups_of_sides(groups: Mapping[str, Ints], dimension: int) -> dict[str, Ints]:
    """Groups as supports and loads on the surface mean them.

    A name that the cells of the body share with one group of lower dimension is that of the latter.

    Parameters
    ----------
    groups : mapping of str to array of int
        Of `RawMesh`.
    dimension : int
        That of the body.
    """
    found = dict(groups)
    for name in groups:
        bare = name.removeprefix(f"{KINDS[dimension]} ")
        lower = [each for kind in KINDS[:dimension] if (each := f"{kind} {bare}") in groups]
        if bare != name and bare not in groups and len(lower) == 1:
            found[bare] = groups[lower[0]]
    return found


def missing_group(name: str, groups: Mapping[str, Ints]) -> str:
    """Say why a mesh has no group of a name."""
    several = [each for kind in KINDS if (each := f"{kind} {name}") in groups]
    if several:
        return f"group '{name}': the mesh has several, expected one of {', '.join(several)}"
    named = f"no such group, but {', '.join(sorted(groups))}" if groups else "no groups"
    return f"group '{name}': the mesh has {named}"


@dataclass(frozen=True)
class RawMesh:
    """Nodes and cells of one type, with named groups of nodes.

    Attributes
    ----------
    coordinates : array, (n_nodes, d)
        Node positions in m.
    cells : array of int, (n_cells, n_corners)
        Node numbers of every cell, in VTK order.
    cell_type : str
        meshio's name: triangle, quad, tetra or hexahedron.
    groups : mapping of str to array of int
        Node numbers of every named group (`datagen.mesh.groups.by_name`).
    cell_groups : mapping of str to array of int
        Cell numbers of every named group of cells.
    places : array of int, (n_nodes,), optional
        Number of every node in the file that the mesh is from, counted from 0, ascending; of a
        refined mesh those of the nodes that it had before, which come first.
    counted_from : tuple of int
        Numbers that the first node of the file can have: 0 and 1 if the file has its nodes in turn,
        one of them if it numbers them otherwise, none if its numbers are not known.
    origins : array of int, (n_nodes, n_corners), optional
        Of a refined mesh: the nodes that it had before of the edge, face or cell that each node
        lies in; repeated ones fill a row (`datagen.mesh.refinement`).
    parts : mapping of str to GroupParts
        Facets and cells of the groups whose nodes do not tell them (`datagen.mesh.groups`).
    shapes : ShapeFamily, optional
        Where the nodes are in other shapes of the body; this mesh is that of the reference.
    """

    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    cell_groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    places: NDArray[np.int64] | None = None
    counted_from: tuple[int, ...] = (0, 1)
    origins: NDArray[np.int64] | None = None
    parts: Mapping[str, GroupParts] = field(default_factory=dict)
    shapes: ShapeFamily | None = None

    @property
    def node_sets(self) -> dict[str, NDArray[np.bool_]]:
        """Nodes of every named group, (n_nodes,) each."""
        sets = {}
        for name, members in self.groups.items():
            sets[name] = np.zeros(len(self.coordinates), dtype=bool)
            sets[name][members] = True
        return sets
