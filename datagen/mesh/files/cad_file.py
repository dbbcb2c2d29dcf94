"""Mesh of a CAD file: gmsh reads it by OpenCASCADE and fills it with triangles or tetrahedra.

STEP and IGES say their unit of length, which is converted to metres; BREP has none and is taken as
it is. Bodies that touch or overlap are joined, so that they have the nodes between them in common.
Faces that bound a body without saying so, as those of IGES do, are sewn together to one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from datagen.mesh.gmsh_model import generate, gmsh_session, mesh_of
from shared_schema.common.bodies.groups import RawMesh

IGES = (".iges", ".igs")
SUFFIXES = (".step", ".stp", *IGES, ".brep")
MILLIMETRE = 1e-3
SEWN = 1e-5  # of the size of the faces: gaps between them that are closed
FLAT = 1e-4  # of the size of the faces: heights that gmsh gives plane ones


def is_cad(path: Path | str) -> bool:
    """True if a file name ends as one of a CAD file."""
    return Path(path).suffix.lower() in SUFFIXES


def mesh_of_cad(path: Path, size: float) -> RawMesh:
    """Mesh the bodies of a CAD file, or its faces if they lie in the plane z = 0.

    Parameters
    ----------
    path : Path
    size : float
        Largest edge of a cell in m, roughly.

    Raises
    ------
    ValueError
        If the file holds no bodies, or the mesh is unfit.
    """
    with gmsh_session() as gmsh:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        occ = gmsh.model.occ
        shapes = _imported(gmsh, path)
        if not shapes:
            raise ValueError("no body or face in it")
        dimension = max(each for each, _ in shapes)
        bodies = [shape for shape in shapes if shape[0] == dimension]
        if len(bodies) > 1:
            occ.fragment(bodies[:1], bodies[1:])
        occ.synchronize()
        generate(gmsh, dimension)
        return mesh_of(gmsh.model)


def _imported(gmsh: Any, path: Path) -> list[tuple[int, int]]:
    """Shapes of highest dimension in a file, in metres."""
    occ, is_iges = gmsh.model.occ, path.suffix.lower() in IGES
    if not is_iges:  # OpenCASCADE knows no unit before its first STEP file, and gives IGES in mm
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    shapes: list[tuple[int, int]] = occ.importShapes(str(path))
    if is_iges:
        occ.dilate(shapes, 0, 0, 0, *(MILLIMETRE,) * 3)
    occ.synchronize()
    if {dimension for dimension, _ in shapes} != {2}:
        return shapes
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    size = np.ptp(box, axis=0).max()
    if np.abs(box[:, 2]).max() > FLAT * size:
        # Shapes that are named are no longer sewn to each other from gmsh 4.13 on, all of them are.
        occ.healShapes([], SEWN * size, False, False, False, True, True)
        occ.synchronize()
        bodies = gmsh.model.getEntities(3)
        if not bodies:
            raise ValueError(
                f"{len(shapes)} faces that bound no body, expected closed ones, or faces in the "
                "plane z = 0"
            )
        return list(bodies)
    return shapes
