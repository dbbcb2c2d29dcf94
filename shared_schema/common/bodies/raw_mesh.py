"""A mesh as plain arrays: nodes, cells of one type, and named groups of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.groups import GroupParts


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
        Node numbers of every named group (`datagen.mesh.group_names.by_name`).
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
        Facets and cells of the groups whose nodes do not tell them (`datagen.mesh.group_parts`).
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

    @property
    def node_sets(self) -> dict[str, NDArray[np.bool_]]:
        """Nodes of every named group, (n_nodes,) each."""
        sets = {}
        for name, members in self.groups.items():
            sets[name] = np.zeros(len(self.coordinates), dtype=bool)
            sets[name][members] = True
        return sets
