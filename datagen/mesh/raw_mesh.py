"""Meshes from points and blocks of cells, the checks that they are fit for use, and their files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.groups import (
    Blocks,
    CellSets,
    Group,
    by_name,
    dimension_of,
    nodes_of_cells,
    parts_of_groups,
)
from shared_schema.common.bodies.cells import (
    CELL_TYPES,
    cell_names,
    conformity_problem,
    node_problem,
    scaled_jacobians,
)
from shared_schema.common.bodies.groups import GroupParts, RawMesh
from shared_schema.common.bodies.shape_family import NAMES, ShapeFamily

DIMENSION = {"triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}
SMALLEST = 1e-9  # smallest |Jacobian| at a corner, over the product of the edge lengths there


def write_raw_mesh(path: Path, mesh: RawMesh) -> None:
    """Write a mesh to an ``.npz`` file, its groups as ``group:NAME``, ``cells:NAME`` and so on."""
    groups = {f"group:{name}": members for name, members in mesh.groups.items()}
    groups |= {f"cells:{name}": members for name, members in mesh.cell_groups.items()}
    groups |= {f"sides of:{name}": part.facets for name, part in mesh.parts.items()}
    groups |= {f"cells of:{name}": part.cells for name, part in mesh.parts.items()}
    if mesh.places is not None:
        groups["places"] = mesh.places
    if mesh.shapes is not None:
        groups |= {name: np.asarray(each) for name, each in mesh.shapes.arrays().items()}
        groups[NAMES] = np.array(mesh.shapes.names)
    np.savez(
        path,
        coordinates=mesh.coordinates,
        cells=mesh.cells,
        cell_type=np.array(mesh.cell_type),
        counted_from=np.array(mesh.counted_from, dtype=np.int64),
        **groups,  # type: ignore[arg-type]
    )


def read_raw_mesh(path: Path) -> RawMesh:
    """Read a mesh that `write_raw_mesh` wrote."""
    with np.load(path) as file:
        groups = _named(file, "group:")
        cell_groups = _named(file, "cells:")
        sides, inside = _named(file, "sides of:"), _named(file, "cells of:")
        cell_type = str(file["cell_type"])
        return RawMesh(
            file["coordinates"],
            file["cells"],
            cell_type,
            groups,
            cell_groups,
            file.get("places"),
            tuple(file["counted_from"].tolist()),
            parts={name: GroupParts(sides[name], inside[name]) for name in sides},
            shapes=ShapeFamily.of_arrays(file),
        )


def _named(file: Mapping[str, NDArray[np.int64]], kind: str) -> dict[str, NDArray[np.int64]]:
    """Arrays of a file whose names begin with a kind, by the rest of their names."""
    return {name.removeprefix(kind): file[name] for name in file if name.startswith(kind)}


def raw_mesh(
    points: NDArray[np.float64],
    blocks: Blocks,
    groups: Mapping[Group, NDArray[np.int64]] = MappingProxyType({}),
    cell_sets: CellSets = MappingProxyType({}),
    labels: NDArray[np.int64] | None = None,
    *,
    is_numbered: bool = True,
) -> RawMesh:
    """Make a mesh of the cells of highest dimension, without the nodes that belong to none of them.

    Parameters
    ----------
    points : array, (n_points, 2 or 3)
        Positions in m.
    blocks : list of (cell type, array of int (n_cells, n_corners))
        Cells of any dimension: meshio's name of their type, and their points in VTK order.
    groups : mapping of (dimension, name) to array of int
        Points of every named group, by their place in `points`.
    cell_sets : mapping of str to sequence of array of int
        Cells of every named group, for each block in turn; None stands for none. Their points are
        groups as well.
    labels : array of int, (n_points,), optional
        Numbers that the points have in the file; their nodes are in the order of them.
    is_numbered : bool
        Without labels: False if the points have numbers in the file that are not known.

    Raises
    ------
    ValueError
        If two points have one number, the cells are not of one linear type, a cell is flat or
        turned over at a corner or has a `conformity_problem`, a coordinate is not finite, or a mesh
        of surface cells leaves the plane z = 0.
    """
    groups = {**groups}
    for group, members in nodes_of_cells(blocks, cell_sets).items():
        groups[group] = np.union1d(groups.get(group, members), members)
    solid = [(name, cells) for name, cells in blocks if len(cells) and dimension_of(name) > 1]
    in_space = [(name, cells) for name, cells in solid if dimension_of(name) == 3]
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
    if labels is None:
        places = used
        counted_from: tuple[int, ...] = (0, 1) if is_numbered else ()
    else:
        places, counted_from = _numbering(labels)
        used = used[np.argsort(places[used])]
        places = places[used]
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
    named = by_name({group: members for group, members in numbered.items() if members.size})
    of_cells = _cell_groups(blocks, cell_sets, name)
    positions = np.ascontiguousarray(coordinates[:, :dimension])
    mesh = RawMesh(positions, number[cells], name, named, of_cells, places, counted_from)
    _require_regular(mesh)
    problem = conformity_problem(mesh.coordinates, mesh.cells, mesh.cell_type)
    if problem is not None:
        raise ValueError(problem)
    parts = parts_of_groups(blocks, cell_sets, number, mesh.cells, name, named, of_cells)
    return replace(mesh, parts=parts)


def _numbering(labels: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[int, ...]]:
    """Numbers of points counted from 0, and those that the first can have, from their labels."""
    require_different("node", labels)
    first = 1 if labels.min() > 0 else 0
    in_turn = np.array_equal(labels, np.arange(len(labels)) + first)
    return labels - first, (0, 1) if in_turn else (first,)


def require_different(what: str, labels: NDArray[np.int64]) -> None:
    """Raise ValueError if a node or element of a file has a negative number, or that of another."""
    numbers, counts = np.unique(labels, return_counts=True)
    if len(numbers) and numbers[0] < 0:
        raise ValueError(f"{what} {numbers[0]}: expected a number that is not negative")
    if (counts > 1).any():
        number = numbers[counts.argmax()]
        raise ValueError(f"{what} {number} stands there {counts.max()} times, expected once")


def _cell_groups(blocks: Blocks, cell_sets: CellSets, kept: str) -> dict[str, NDArray[np.int64]]:
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


def _require_regular(mesh: RawMesh) -> None:
    """Raise ValueError if a cell is flat or turned over at one of its corners.

    At each corner the Jacobian is the determinant of the d edges that meet there; divided by the
    product of their lengths it is between −1 and 1. It must have one sign at all corners of a cell.
    """
    scaled = scaled_jacobians(mesh.coordinates, mesh.cells, mesh.cell_type)
    wrong = np.flatnonzero(~((scaled > SMALLEST).all(axis=1) | (scaled < -SMALLEST).all(axis=1)))
    if wrong.size:
        at = ",".join(f"{x:g}" for x in mesh.coordinates[mesh.cells[wrong[0]]].mean(axis=0))
        raise ValueError(f"{cell_names(wrong)}: flat or turned over at a corner, the first at {at}")
