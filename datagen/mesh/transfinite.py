"""Base of the geometries that are described in the case file and meshed by gmsh."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any

from pydantic import Field

from datagen.mesh.gmsh_model import gmsh_session, mesh_of
from datagen.mesh.raw_mesh import RawMesh
from shared_schema.common.configuration import Frozen

PositiveInt = Annotated[int, Field(gt=0)]


class Transfinite(Frozen):
    """A geometry that gmsh meshes by transfinite curves and surfaces; lengths are in m."""

    @abstractmethod
    def build(self, model: Any) -> None:
        """Draw and mesh the geometry in the current gmsh model."""

    def raw_mesh(self) -> RawMesh:
        """Generate the mesh with gmsh."""
        with gmsh_session() as gmsh:
            self.build(gmsh.model)
            return mesh_of(gmsh.model)
