"""Tetrahedra inside a closed surface of triangles (STL), as a segmentation or a scanner gives it.

gmsh keeps the triangles of the file, or lays others of a given size on the surface.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from datagen.mesh.raw_mesh import RawMesh

SUFFIX = ".stl"
TRIANGLE = 2  # gmsh's number of the type


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
        If the surface is not closed, or the mesh is unfit.
    """
    with gmsh_session() as gmsh:
        gmsh.merge(str(path))
        _require_closed(gmsh.model)
        if size is not None:
            gmsh.model.mesh.classifySurfaces(math.pi, True, True, math.pi)
            gmsh.model.mesh.createGeometry()
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        loop = gmsh.model.geo.addSurfaceLoop([tag for _, tag in gmsh.model.getEntities(2)])
        gmsh.model.geo.addVolume([loop])
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.generate(3)
        return mesh_of(gmsh.model)


def _require_closed(model: Any) -> None:
    """Raise ValueError unless every edge has two triangles."""
    triangles = model.mesh.getElementsByType(TRIANGLE)[1].reshape(-1, 3)
    if len(triangles) == 0:
        raise ValueError("no triangle in it")
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    open_edges = int((counts != 2).sum())
    if open_edges:
        raise ValueError(
            f"the surface is not closed: {open_edges} of its {len(counts)} edges have another "
            "number of triangles than two"
        )
