r"""Tetrahedra inside a closed surface of triangles (STL, OBJ, PLY), as from a scanner.

gmsh keeps the triangles of the file, or lays others of a given size on the surface. Each body is
meshed alone, around its rooms.

A shell is a closed part of the surface, a set of triangles that edges connect, each edge being one
of two triangles. Inside an odd number of others it bounds a room, and its triangles are seen from
there. Its volume is

.. math:: V = \tfrac16 \sum_i a_i · (b_i × c_i)

over its triangles with the corners a, b, c, positive if they are seen from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.gmsh_model import generate, gmsh_session
from datagen.mesh.overlap import near_pairs
from datagen.mesh.raw_mesh import raw_mesh
from shared_schema.common.bodies.cells import boundary_facets, parts_of
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.tools.closed_surface import read_triangles

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
EDGES = [[0, 1], [1, 2], [2, 0]]  # corners of the edges of a triangle
TOUCHING = 1e-9  # part of a length by which what only touches may cut
RAY = np.array([0.4823, 0.6271, 0.6114])  # a direction that no edge has by design
SUFFIXES = (".stl", ".obj", ".ply")
TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers of the types
REPAIR = "`datagen repair` makes one closed surface of it"
EXACT = 1e-6  # relative difference of the volumes inside of the triangles and of the cells


@dataclass(frozen=True)
class Body:
    """A body within a surface.

    Attributes
    ----------
    shells : list of array of int
        Numbers of the triangles of its outside, and of those of each of its rooms.
    volume : float
        In m³; NaN if the triangles of its only shell are not all seen from one side.
    """

    shells: list[Ints]
    volume: float


def bodies_of(points: Array, triangles: Ints) -> list[Body]:
    """Find the bodies that a surface bounds.

    Parameters
    ----------
    points : array, (n_points, 3)
        In m.
    triangles : array of int, (n_triangles, 3)

    Raises
    ------
    ValueError
        If the surface is not closed, cuts itself, or has a shell in another one that is seen from
        the same side; with a place.
    """
    if not len(triangles):
        raise ValueError("no triangle in it, expected a closed surface")
    _require_closed(points, triangles)
    _require_uncut(points, triangles)
    number = parts_of(triangles, "triangle")
    shells = [np.flatnonzero(number == shell) for shell in range(int(number.max()) + 1)]
    corners = [points[triangles[shell]] for shell in shells]
    volumes = [
        _volume(x) if _is_seen_from_one_side(triangles[shell]) else np.nan
        for x, shell in zip(corners, shells, strict=True)
    ]
    around = [
        [other for other, x in enumerate(corners) if other != each and _is_inside(inner[0, 0], x)]
        for each, inner in enumerate(corners)
    ]
    bodies = []
    for outer, outside in enumerate(around):
        if len(outside) % 2:
            continue
        rooms = [
            each
            for each, those in enumerate(around)
            if outer in those and len(those) == len(outside) + 1
        ]
        for room in rooms:
            if not volumes[outer] * volumes[room] < 0:
                raise ValueError(
                    f"the closed part of the surface at {_at(corners[room][0, 0])} lies in another "
                    "one and is seen from the same side, expected it to be a room, whose triangles "
                    "are seen from the room, or a part of the body's outside"
                )
        volume = abs(volumes[outer]) - sum(abs(volumes[room]) for room in rooms)
        bodies.append(Body([shells[each] for each in (outer, *rooms)], volume))
    return bodies


def _require_closed(points: Array, triangles: Ints) -> None:
    """Raise ValueError unless every edge has two triangles."""
    edges = np.sort(triangles[:, EDGES].reshape(-1, 2), axis=1)
    lines, counts = np.unique(edges, axis=0, return_counts=True)
    wrong = np.flatnonzero(counts != 2)
    if wrong.size:
        at = _at(points[lines[wrong[0]]].mean(axis=0))
        raise ValueError(
            f"the surface is not closed: {wrong.size} of its {len(lines)} edges have another "
            f"number of triangles than two, the first at {at}; {REPAIR}"
        )


def _require_uncut(points: Array, triangles: Ints) -> None:
    """Raise ValueError if an edge of a triangle goes through another one."""
    corners, every = points[triangles], np.arange(len(triangles))
    for some, others in near_pairs(corners, every, np.ones(len(every), dtype=bool)):
        a, b, c = np.moveaxis(corners[others], 1, 0)
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal, axis=1)
        for ends in EDGES:
            p, q = np.moveaxis(corners[some][:, ends], 1, 0)
            least = TOUCHING * np.linalg.norm(q - p, axis=1) * size
            before = ((p - a) * normal).sum(axis=1)
            after = ((q - a) * normal).sum(axis=1)
            across = (before * after < 0) & (np.minimum(abs(before), abs(after)) > least)
            is_end = triangles[some][:, ends, None] == triangles[others][:, None]
            across &= ~is_end.any(axis=(1, 2))
            part = np.where(across, before / np.where(across, before - after, 1.0), 0.0)
            x = p + part[:, None] * (q - p)
            weights = [
                (np.cross(v - u, x - u) * normal).sum(axis=1) for u, v in ((a, b), (b, c), (c, a))
            ]
            cut = np.flatnonzero(across & (np.min(weights, axis=0) >= -TOUCHING * size**2))
            if cut.size:
                raise ValueError(
                    f"the surface cuts itself at {_at(x[cut[0]])}, expected bodies that are apart; "
                    f"{REPAIR}"
                )


def _is_seen_from_one_side(triangles: Ints) -> bool:
    """True if every edge of a closed surface is gone through once in each direction."""
    edges = triangles[:, EDGES].reshape(-1, 2)
    return len(np.unique(edges, axis=0)) == len(edges)


def _volume(corners: Array) -> float:
    """Signed volume inside triangles, (n, 3, 3)."""
    return float(np.linalg.det(corners - corners.mean(axis=(0, 1))).sum()) / 6


def _is_inside(point: Array, corners: Array) -> bool:
    """True if a ray from a point meets an odd number of triangles, (n, 3, 3)."""
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if (point < low).any() or (point > high).any():
        return False
    a, b, c = np.moveaxis(corners - point, 1, 0)
    sides = [
        np.linalg.det(np.stack([np.broadcast_to(RAY, u.shape), u, v], axis=1))
        for u, v in ((a, b), (b, c), (c, a))
    ]
    through = (np.min(sides, axis=0) > 0) | (np.max(sides, axis=0) < 0)
    normal = np.cross(b - a, c - a)
    ahead = (a * normal).sum(axis=1) * (normal @ RAY) > 0
    return bool((through & ahead).sum() % 2)


def _at(position: Array) -> str:
    return ",".join(f"{value:g}" for value in position)


def is_surface(path: Path | str) -> bool:
    """True if a file name ends as that of a surface."""
    return Path(path).suffix.lower() in SUFFIXES


def mesh_inside(path: Path, size: float | None) -> RawMesh:
    """Fill a surface with tetrahedra, as `filled` does; errors name what may help."""
    points, triangles = read_triangles(path)
    bodies_of(points, triangles)
    try:
        return filled(points, triangles, size)
    except ValueError as error:
        anew = "" if size is not None else "'size' lays other triangles on the surface, "
        raise ValueError(f"{error}; {anew}{REPAIR}") from None


def filled(points: Array, triangles: Ints, size: float | None) -> RawMesh:
    """Fill a surface with tetrahedra.

    Parameters
    ----------
    points : array, (n_points, 3)
    triangles : array of int, (n_triangles, 3)
    size : float, optional
        Largest edge of a cell in the unit of the points, roughly; the triangles stay without it.

    Raises
    ------
    ValueError
        If the surface is not closed or cuts itself (`bodies_of`), gmsh fails or fills something
        else, or the mesh is unfit.
    """
    positions, blocks, start = [], [], 0
    with gmsh_session() as gmsh:
        if size is not None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        for body in bodies_of(points, triangles):
            at, cells = _filled(gmsh, points, triangles, body, size is not None)
            positions.append(at)
            blocks.append(("tetra", start + cells))
            start += len(at)
    return raw_mesh(np.concatenate(positions), blocks)


def _filled(
    gmsh: Any, points: Array, triangles: Ints, body: Body, anew: bool
) -> tuple[Array, Ints]:
    """Nodes and tetrahedra of a body, within its own triangles or others laid `anew`."""
    model = gmsh.model
    model.add("body")
    for shell in body.shells:
        surface = model.addDiscreteEntity(2)
        nodes = np.unique(triangles[shell])
        new = np.setdiff1d(nodes + 1, model.mesh.getNodes()[0])  # rooms may touch the outside
        model.mesh.addNodes(2, surface, new, points[new - 1].ravel())
        model.mesh.addElementsByType(surface, TRIANGLE, [], (triangles[shell] + 1).ravel())
    if anew:
        model.mesh.classifySurfaces(math.pi, True, True, math.pi)
        model.mesh.createGeometry()
    loop = model.geo.addSurfaceLoop([tag for _, tag in model.getEntities(2)])
    model.geo.addVolume([loop])
    model.geo.synchronize()
    generate(gmsh, 3)
    tags, positions, _ = model.mesh.getNodes()
    order = np.argsort(tags)
    corners = model.mesh.getElementsByType(TETRAHEDRON)[1].reshape(-1, 4)
    cells = np.searchsorted(tags[order], corners).astype(np.int64)
    at = positions.reshape(-1, 3)[order]
    model.remove()
    _require_filled(at, cells, body, anew)
    return at, cells


def _require_filled(at: Array, cells: Ints, body: Body, anew: bool) -> None:
    """Raise ValueError unless the cells fill a body and leave its rooms empty."""
    shells = int(parts_of(boundary_facets(cells, "tetra"), "triangle").max(initial=-1)) + 1
    if shells != len(body.shells):
        raise ValueError(
            f"gmsh fills a body with {shells} closed parts of its surface, of {len(body.shells)} "
            "in the file, expected all"
        )
    volume = np.abs(np.linalg.det(at[cells[:, 1:]] - at[cells[:, :1]])).sum() / 6
    if not anew and abs(volume - body.volume) > EXACT * body.volume:
        raise ValueError(f"gmsh fills {volume:g} of the {body.volume:g} m³ within the surface")
