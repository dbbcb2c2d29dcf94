"""Zones of a body: the cells whose centres lie inside of closed surfaces, each a group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.groups import parts_of_groups
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError
from shared_schema.points_in_cells import locate
from shared_schema.tools.closed_surface import Surface

Cells = Mapping[str, NDArray[np.int64]]
REST = "rest"  # group of the cells that are in no zone
OF_ZONES = "zones."  # before what is wrong with one


def with_zones(mesh: RawMesh, zones: Mapping[str, Path]) -> RawMesh:
    """Make a group of the cells in each zone, and `REST` of the others.

    Parameters
    ----------
    mesh : RawMesh
        A body in space.
    zones : mapping of str to Path
        Closed surfaces by the names of their groups, in the unit of the mesh.

    Raises
    ------
    ValueError
        If a surface is not closed, no cell has its centre inside, or two zones share a cell; if the
        body is plane, or has a group of such a name.
    """
    if mesh.coordinates.shape[1] != 3:
        raise ValueError(f"{OF_ZONES}{next(iter(zones))}: the body is plane, expected one in space")
    centres = mesh.coordinates[mesh.cells].mean(axis=1)
    owner = np.full(len(centres), -1)
    names = list(zones)
    for number, (name, path) in enumerate(zones.items()):
        try:
            surface = Surface.read(path, 1.0)
        except InputError as error:
            raise ValueError(f"{OF_ZONES}{name}: {error}") from None
        members = surface.nearest(centres).distance < 0
        if not members.any():
            beside = locate(surface.corners, mesh.coordinates, mesh.cells, mesh.cell_type)[2]
            said = "it lies outside of the body"
            if (beside == 0).any():
                said = "no cell has its centre in it, expected smaller cells"
            raise ValueError(f"{OF_ZONES}{name}: {said}")
        if (shared := members & (owner >= 0)).any():
            other, at = names[owner[shared.argmax()]], centres[shared.argmax()]
            raise ValueError(
                f"{OF_ZONES}{name}: it overlaps with zone '{other}' at "
                f"{','.join(f'{x:g}' for x in at)}, expected zones that are apart"
            )
        owner[members] = number
    found = {name: np.flatnonzero(owner == number) for number, name in enumerate(zones)}
    if (owner < 0).any():
        found[REST] = np.flatnonzero(owner < 0)
    return with_cell_groups(mesh, found)


def with_cell_groups(mesh: RawMesh, cells: Cells) -> RawMesh:
    """Add groups of cells to a mesh; ValueError if it has one of such a name."""
    for name in cells:
        if name in mesh.groups or name in mesh.cell_groups:
            raise ValueError(f"{OF_ZONES}{name}: the mesh has a group of this name already")
    groups = {name: np.unique(mesh.cells[members]) for name, members in cells.items()}
    parts = parts_of_groups(
        [(mesh.cell_type, mesh.cells)],
        {name: [members] for name, members in cells.items()},
        np.arange(len(mesh.coordinates)),
        mesh.cells,
        mesh.cell_type,
        groups,
        cells,
    )
    return replace(
        mesh,
        groups={**mesh.groups, **groups},
        cell_groups={**mesh.cell_groups, **cells},
        parts={**mesh.parts, **parts},
    )
