"""Meshes from gmsh, distributed by dolfinx, with the node numbers of gmsh kept.

Everything that leaves the solver is numbered as gmsh numbered it ("node number"), whatever order
dolfinx chooses inside; `NodeNumbering` is the way between the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.geometries import Geometry


@dataclass(frozen=True)
class NodeNumbering:
    """The way between gmsh's node numbers and the degrees of freedom of a P1 vector space.

    Attributes
    ----------
    node_of_block : array of int, (n_local_blocks,)
        Node number of each block of d degrees of freedom on this rank, owned ones first.
    owned : int
        How many of the blocks this rank owns.
    total : int
        Number of nodes of the whole mesh.
    """

    node_of_block: NDArray[np.int64]
    owned: int
    total: int

    def owned_blocks(self, nodes: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Find the blocks of some nodes that this rank owns.

        Returns
        -------
        positions : array of int
            Where in `nodes` the owned ones stand.
        blocks : array of int
            Their local block numbers.
        """
        block_of_node = np.full(self.total, -1, dtype=np.intp)
        block_of_node[self.node_of_block[: self.owned]] = np.arange(self.owned)
        blocks = block_of_node[nodes]
        positions = np.flatnonzero(blocks >= 0)
        return positions, blocks[positions]


@dataclass(frozen=True)
class Mesh:
    """A mesh as dolfinx holds it, and as the dataset will store it.

    Attributes
    ----------
    domain : dolfinx.mesh.Mesh
        Distributed over the ranks of its communicator.
    coordinates : array, (n_nodes, d)
        All nodes by node number, in m; the same on every rank.
    cells : array of int, (n_cells, n_corners)
        Node numbers of every cell, in VTK order; the same on every rank.
    cell_type : str
        meshio's name: quad, triangle, hexahedron, tetra.
    """

    domain: Any
    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str


MESHIO_NAMES = {
    "quadrilateral": "quad",
    "triangle": "triangle",
    "hexahedron": "hexahedron",
    "tetrahedron": "tetra",
}


def make_mesh(geometry: Geometry, comm: Any) -> Mesh:
    """Mesh a geometry with gmsh on rank 0 of `comm` and distribute it over the ranks.

    Parameters
    ----------
    geometry : Geometry
        What to mesh.
    comm : mpi4py communicator
        The ranks that share the mesh. Collective.
    """
    import dolfinx
    import gmsh
    from dolfinx.io import gmshio

    if comm.rank == 0:
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mesh")
        geometry.build(gmsh.model)
    try:
        domain, _, _ = gmshio.model_to_mesh(gmsh.model, comm, 0, gdim=geometry.dimension)
    finally:
        if comm.rank == 0:
            gmsh.finalize()

    name = domain.topology.cell_type.name
    placed = domain.geometry
    number = np.asarray(placed.input_global_indices, dtype=np.int64)
    owned = placed.index_map().size_local
    coordinates = np.empty((placed.index_map().size_global, geometry.dimension))
    here = number[:owned], placed.x[:owned, : geometry.dimension]
    for numbers, points in comm.allgather(here):
        coordinates[numbers] = points

    owned_cells = domain.topology.index_map(domain.topology.dim).size_local
    corners = placed.dofmap.array.reshape(-1, placed.dofmap.links(0).size)[:owned_cells]
    to_vtk = dolfinx.cpp.io.perm_vtk(domain.topology.cell_type, corners.shape[1])
    cells = np.concatenate(comm.allgather(number[corners][:, np.argsort(to_vtk)]))
    return Mesh(domain, coordinates, cells[np.lexsort(cells.T[::-1])], MESHIO_NAMES[name])


def node_numbering(mesh: Mesh, space: Any) -> NodeNumbering:
    """Number the blocks of `space` (P1 or Q1 vectors on `mesh`) as gmsh numbered its nodes."""
    geometry = mesh.domain.geometry
    number = np.asarray(geometry.input_global_indices, dtype=np.int64)
    index_map = space.dofmap.index_map
    node_of_block = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    node_of_block[space.dofmap.list.array] = number[geometry.dofmap.array]
    return NodeNumbering(node_of_block, index_map.size_local, index_map.size_global)
