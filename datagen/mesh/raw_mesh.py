"""Mesh as plain arrays, before it is distributed, and the checks that it is fit for use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.cells import CELL_TYPES, NEIGHBOURS
from shared_schema.common.bodies.conformity import cell_names, conformity_problem, node_problem

DIMENSION = {"triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}
SMALLEST = 1e-9  # smallest |Jacobian| at a corner, over the product of the edge lengths there


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
        Node numbers of every named group.
    cell_groups : mapping of str to array of int
        Cell numbers of every named group of cells.
    places : array of int, (n_nodes,), optional
        Place of every node in the file that the mesh is from, from 0, ascending; of a refined mesh
        those of the nodes that it had before, which come first.
    origins : array of int, (n_nodes, n_corners), optional
        Of a refined mesh: the nodes that it had before of the edge, face or cell that each node
        lies in; repeated ones fill a row (`datagen.mesh.refinement`).
    """

    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    cell_groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    places: NDArray[np.int64] | None = None
    origins: NDArray[np.int64] | None = None

    @property
    def node_sets(self) -> dict[str, NDArray[np.bool_]]:
        """Nodes of every named group, (n_nodes,) each."""
        sets = {}
        for name, members in self.groups.items():
            sets[name] = np.zeros(len(self.coordinates), dtype=bool)
            sets[name][members] = True
        return sets


def write_raw_mesh(path: Path, mesh: RawMesh) -> None:
    """Write a mesh to an ``.npz`` file, its groups as ``group:NAME`` and ``cells:NAME``."""
    groups = {f"group:{name}": members for name, members in mesh.groups.items()}
    groups |= {f"cells:{name}": members for name, members in mesh.cell_groups.items()}
    if mesh.places is not None:
        groups["places"] = mesh.places
    np.savez(
        path,
        coordinates=mesh.coordinates,
        cells=mesh.cells,
        cell_type=np.array(mesh.cell_type),
        **groups,  # type: ignore[arg-type]
    )


def read_raw_mesh(path: Path) -> RawMesh:
    """Read a mesh that `write_raw_mesh` wrote."""
    with np.load(path) as file:
        groups = _named(file, "group:")
        cell_groups = _named(file, "cells:")
        cell_type = str(file["cell_type"])
        places = file.get("places")
        return RawMesh(file["coordinates"], file["cells"], cell_type, groups, cell_groups, places)


def _named(file: Mapping[str, NDArray[np.int64]], kind: str) -> dict[str, NDArray[np.int64]]:
    """Arrays of a file whose names begin with a kind, by the rest of their names."""
    return {name.removeprefix(kind): file[name] for name in file if name.startswith(kind)}


def raw_mesh(
    points: NDArray[np.float64],
    blocks: list[tuple[str, NDArray[np.int64]]],
    groups: Mapping[str, NDArray[np.int64]],
    cell_sets: Mapping[str, Sequence[NDArray[np.int64] | None]] = MappingProxyType({}),
) -> RawMesh:
    """Make a mesh of the cells of highest dimension, without the nodes that belong to none of them.

    Parameters
    ----------
    points : array, (n_points, 2 or 3)
        Positions in m.
    blocks : list of (cell type, array of int (n_cells, n_corners))
        Cells of any dimension: meshio's name of their type, and their points in VTK order.
    groups : mapping of str to array of int
        Point numbers of every named group.
    cell_sets : mapping of str to sequence of array of int
        Cells of every named group, for each block in turn; None stands for none.

    Raises
    ------
    ValueError
        If the cells are not of one linear type, a cell is flat or turned over at a corner or has a
        `conformity_problem`, a coordinate is not finite, or a mesh of surface cells leaves the
        plane z = 0.
    """
    solid = [(name, cells) for name, cells in blocks if len(cells) and not _is_lower(name)]
    in_space = [(name, cells) for name, cells in solid if DIMENSION.get(name, 3) == 3]
    kept = in_space or solid
    names = sorted({name for name, _ in kept})
    if len(names) != 1 or names[0] not in CELL_TYPES:
        found = ", ".join(names) or "none"
        raise ValueError(f"cells are {found}, expected one of {', '.join(CELL_TYPES)}")
    name, dimension = names[0], DIMENSION[names[0]]
    cells = np.concatenate([cells for _, cells in kept]).astype(np.int64)
    used = np.unique(cells)
    if used[0] < 0 or used[-1] >= len(points):
        raise ValueError(str(node_problem(cells, len(points))))
    coordinates = np.asarray(points[used], dtype=np.float64)
    if not np.isfinite(coordinates).all():
        raise ValueError("a coordinate is a NaN or an infinity")
    size = float(np.ptp(coordinates, axis=0).max())
    if dimension == 2 and np.abs(coordinates[:, 2:]).max(initial=0.0) > SMALLEST * size:
        raise ValueError("a mesh of surface cells leaves the plane z = 0")
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    numbered = {
        group: np.unique(number[members][number[members] >= 0]) for group, members in groups.items()
    }
    of_cells = _cell_groups(blocks, cell_sets, name)
    positions = np.ascontiguousarray(coordinates[:, :dimension])
    mesh = RawMesh(positions, number[cells], name, numbered, of_cells, used)
    _require_regular(mesh)
    problem = conformity_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
    if problem is not None:
        raise ValueError(problem)
    return mesh


def _cell_groups(
    blocks: list[tuple[str, NDArray[np.int64]]],
    cell_sets: Mapping[str, Sequence[NDArray[np.int64] | None]],
    kept: str,
) -> dict[str, NDArray[np.int64]]:
    """Numbers of the cells of one type in every group that holds some."""
    found = {}
    for group, members in cell_sets.items():
        start, parts = 0, [np.empty(0, dtype=np.int64)]
        for (name, cells), chosen in zip(blocks, members, strict=True):
            if name == kept and len(cells):
                if chosen is not None:
                    parts.append(start + np.asarray(chosen, dtype=np.int64))
                start += len(cells)
        numbers = np.unique(np.concatenate(parts))
        if numbers.size:
            found[group] = numbers
    return found


def _is_lower(name: str) -> bool:
    """True for points and lines, which only serve to mark groups."""
    return name.startswith(("vertex", "line"))


def _require_regular(mesh: RawMesh) -> None:
    """Raise ValueError if a cell is flat or turned over at one of its corners.

    At each corner the Jacobian is the determinant of the d edges that meet there; divided by the
    product of their lengths it is between −1 and 1. It must have one sign at all corners of a cell.
    """
    corners = mesh.coordinates[mesh.cells]
    jacobians = []
    for corner, neighbours in enumerate(NEIGHBOURS[mesh.cell_type]):
        edges = corners[:, list(neighbours)] - corners[:, [corner]]
        lengths = np.linalg.norm(edges, axis=2).prod(axis=1)
        jacobians.append(np.linalg.det(edges) / np.where(lengths > 0, lengths, 1.0))
    scaled = np.stack(jacobians, axis=1)
    wrong = np.flatnonzero(~((scaled > SMALLEST).all(axis=1) | (scaled < -SMALLEST).all(axis=1)))
    if wrong.size:
        at = ",".join(f"{x:g}" for x in corners[wrong[0]].mean(axis=0))
        raise ValueError(f"{cell_names(wrong)}: flat or turned over at a corner, the first at {at}")
