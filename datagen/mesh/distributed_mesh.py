"""Meshes distributed by dolfinx, with the node numbers of their source kept.

Everything that leaves the solver is numbered as the mesh was ("node number"), whatever order
dolfinx chooses inside; `NodeNumbering` is the way between the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.mesh.geometry import Geometry
from datagen.mesh.raw_mesh import RawMesh
from datagen.ranks import on_rank_zero


@dataclass(frozen=True)
class NodeNumbering:
    """The way between node numbers and the degrees of freedom of a P1 vector space.

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
    groups : mapping of str to array of int
        Node numbers of every named group; the same on every rank.
    """

    domain: Any
    coordinates: NDArray[np.float64]
    cells: NDArray[np.int64]
    cell_type: str
    groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)


UFL_NAMES = {
    "quad": "quadrilateral",
    "triangle": "triangle",
    "hexahedron": "hexahedron",
    "tetra": "tetrahedron",
}


def make_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Read or make a mesh on rank 0 of `comm` and distribute it over the ranks (collective).

    Parameters
    ----------
    geometry : Geometry
        What to mesh.
    comm : mpi4py communicator
        The ranks that share the mesh.

    Raises
    ------
    InputError
        On every rank, if a mesh file cannot be used.
    """
    return distributed(on_rank_zero(comm, geometry.raw_mesh), comm)


def distributed(raw: RawMesh, comm: MPI.Comm) -> Mesh:
    """Distribute a mesh that every rank of `comm` has over them (collective)."""
    dimension = raw.coordinates.shape[1]
    cell = ufl.Cell(UFL_NAMES[raw.cell_type], geometric_dimension=dimension)
    element = ufl.VectorElement("Lagrange", cell, 1)
    to_dolfinx = dolfinx.cpp.io.perm_vtk(dolfinx.cpp.mesh.to_type(str(cell)), raw.cells.shape[1])
    here = slice(None) if comm.rank == 0 else slice(0)
    domain = dolfinx.mesh.create_mesh(
        comm, raw.cells[here][:, to_dolfinx], raw.coordinates[here], ufl.Mesh(element)
    )
    return Mesh(domain, raw.coordinates, raw.cells, raw.cell_type, raw.groups)


def node_numbering(mesh: Mesh, space: Any) -> NodeNumbering:
    """Number the blocks of `space` (P1 or Q1 vectors on `mesh`) as its nodes are numbered."""
    geometry = mesh.domain.geometry
    number = np.asarray(geometry.input_global_indices, dtype=np.int64)
    index_map = space.dofmap.index_map
    node_of_block = np.empty(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
    node_of_block[space.dofmap.list.array] = number[geometry.dofmap.array]
    return NodeNumbering(node_of_block, index_map.size_local, index_map.size_global)
