"""Mesh of a CAD file: gmsh reads it by OpenCASCADE and fills it with triangles or tetrahedra.

STEP and IGES say their unit of length, which is converted to metres; BREP has none and is taken as
it is. Bodies that touch or overlap are joined, so that they have the nodes between them in common.
"""

from __future__ import annotations

from pathlib import Path

from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from datagen.mesh.raw_mesh import RawMesh

SUFFIXES = (".step", ".stp", ".iges", ".igs", ".brep")


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
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        occ = gmsh.model.occ
        shapes = occ.importShapes(str(path))
        if not shapes:
            raise ValueError("no body or face in it")
        dimension = max(each for each, _ in shapes)
        bodies = [shape for shape in shapes if shape[0] == dimension]
        if len(bodies) > 1:
            occ.fragment(bodies[:1], bodies[1:])
        occ.synchronize()
        gmsh.model.mesh.generate(dimension)
        return mesh_of(gmsh.model)
