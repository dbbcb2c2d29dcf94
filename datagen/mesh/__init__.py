"""Meshes: geometries, mesh files, distributed meshes, node numbers, regions of nodes."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from datagen.mesh.distributed_mesh import distributed
    from datagen.mesh.gmsh_model import gmsh_session, mesh_of
    from datagen.mesh.raw_mesh import raw_mesh

__all__ = ["distributed", "gmsh_session", "mesh_of", "raw_mesh"]
__getattr__, __dir__ = lazy_names(__name__)
