"""Tetrahedra inside a closed surface of triangles (STL), as a segmentation or a scanner gives it.

gmsh keeps the triangles of the file, or lays others of a given size on the surface. Each body is
meshed alone, around its rooms.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.files.closed_shells import Body, bodies_of
from datagen.mesh.gmsh_model import generate, gmsh_session
from datagen.mesh.raw_mesh import raw_mesh
from shared_schema.common.bodies.cells import boundary_facets, parts_of
from shared_schema.common.bodies.groups import RawMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SUFFIX = ".stl"
TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers of the types
EXACT = 1e-6  # relative difference of the volumes inside of the triangles and of the cells


def is_surface(path: Path | str) -> bool:
    """True if a file name ends as that of a surface."""
    return Path(path).suffix.lower() == SUFFIX


def mesh_inside(path: Path, size: float | None) -> RawMesh:
    """Fill a surface with tetrahedra.

    Parameters
    ----------
    path : Path
    size : float, optional
        Largest edge of a cell in m, roughly; the triangles of the file stay without it.

    Raises
    ------
    ValueError
        If the surface is not closed or cuts itself (`bodies_of`), gmsh fails or fills something
        else, or the mesh is unfit.
    """
    with gmsh_session() as gmsh:
        points, triangles = _read(gmsh, path)
        if size is not None:
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        positions, blocks, start = [], [], 0
        for body in bodies_of(points, triangles):
            at, cells = _filled(gmsh, points, triangles, body, size is not None)
            positions.append(at)
            blocks.append(("tetra", start + cells))
            start += len(at)
    return raw_mesh(np.concatenate(positions), blocks)


def _read(gmsh: Any, path: Path) -> tuple[Array, Ints]:
    """Corners and triangles of a file, equal corners joined by gmsh."""
    try:
        gmsh.merge(str(path))
    except Exception as error:  # gmsh raises nothing more special
        raise ValueError(f"gmsh reads no triangles from it ({error})") from None
    tags, points, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    triangles = gmsh.model.mesh.getElementsByType(TRIANGLE)[1].reshape(-1, 3)
    return points.reshape(-1, 3)[order], np.searchsorted(tags[order], triangles)


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
