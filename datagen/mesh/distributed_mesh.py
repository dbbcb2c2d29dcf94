"""Meshes distributed by dolfinx over MPI ranks, with the node numbers of their source kept.

dolfinx renumbers the nodes when it distributes a mesh. Everything that enters or leaves the solver
uses the numbers of the source mesh ("node numbers"); `NodeNumbering` converts between the two.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.dolfinx_versions import create_mesh, geometry_nodes
from datagen.mesh.geometries import Geometry
from datagen.ranks import on_rank_zero
from shared_schema.common.bodies.cells import conformity_problem
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import InputError


@dataclass(frozen=True)
class Mesh(RawMesh):
    """A mesh in two forms: distributed by dolfinx, and as whole arrays, the same on every rank.

    Attributes
    ----------
    domain : dolfinx.mesh.Mesh
        Distributed over the ranks of its communicator.
    """

    domain: Any = field(kw_only=True)

    def of_local_cells(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of the cells of this rank, ghosts included, from those of all cells."""
        return values[np.asarray(self.domain.topology.original_cell_index)]


UFL_NAMES = {
    "quad": "quadrilateral",
    "triangle": "triangle",
    "hexahedron": "hexahedron",
    "tetra": "tetrahedron",
}


def make_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Read or generate a mesh on rank 0 of `comm` and distribute it over the ranks (collective).

    Parameters
    ----------
    geometry : Geometry
        Geometry or mesh file of the case.
    comm : mpi4py communicator
        The ranks that share the mesh.

    Raises
    ------
    InputError
        On every rank, if a mesh file cannot be read or its mesh is unfit.
    """
    return distributed(on_rank_zero(comm, geometry.raw_mesh), comm)


def distributed(raw: RawMesh, comm: MPI.Comm) -> Mesh:
    """Distribute a mesh over the ranks of `comm`, all of which hold its arrays (collective).

    Raises
    ------
    InputError
        On every rank, if the cells have a `conformity_problem`: dolfinx would damage its memory; or
        if a rank gets no cell.
    """
    problem = conformity_problem(raw.coordinates, raw.cells, raw.cell_type)
    if problem is not None:
        raise InputError(f"mesh: {problem}")
    cell = UFL_NAMES[raw.cell_type]
    to_dolfinx = dolfinx.cpp.io.perm_vtk(dolfinx.cpp.mesh.to_type(cell), raw.cells.shape[1])
    here = slice(None) if comm.rank == 0 else slice(0)  # rank 0 hands in all cells and nodes
    domain = create_mesh(comm, raw.cells[here][:, to_dolfinx], cell, raw.coordinates[here])
    fewest = comm.allreduce(domain.topology.index_map(domain.topology.dim).size_local, op=MPI.MIN)
    if fewest == 0:
        raise InputError(
            f"mesh: {comm.size} ranks share its {len(raw.cells)} cells and one of them gets none, "
            "expected fewer ranks (--ranks-per-solve)"
        )
    whole = {field.name: getattr(raw, field.name) for field in fields(RawMesh)}
    return Mesh(**whole, domain=domain)


@dataclass(frozen=True)
class NodeNumbering:
    """Node numbers of the corners of the cells, or of all points of elements, on one rank.

    The d degrees of freedom of a node form a block. Each block is owned by one rank; ranks that
    share a cell with it hold a copy (ghost). Points of quadratic elements have numbers as well
    (`shared_schema.common.bodies.points_between`).

    Attributes
    ----------
    node_of_block : array of int, (n_local_blocks,)
        Node number of each block on this rank: owned blocks first, ghosts after them.
    owned : int
        Number of blocks that this rank owns.
    total : int
        Number of nodes of the whole mesh.
    """

    node_of_block: NDArray[np.int64]
    owned: int
    total: int

    def owned_blocks(self, nodes: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Find the blocks of given nodes that this rank owns.

        Parameters
        ----------
        nodes : array of int, (n,)
            Node numbers.

        Returns
        -------
        positions : array of int, (n_owned_here,)
            Positions in `nodes` of the nodes that this rank owns.
        blocks : array of int, (n_owned_here,)
            Local block numbers of these nodes.
        """
        block_of_node = np.full(self.total, -1, dtype=np.intp)
        block_of_node[self.node_of_block[: self.owned]] = np.arange(self.owned)
        blocks = block_of_node[nodes]
        positions = np.flatnonzero(blocks >= 0)
        return positions, blocks[positions]

    def gathered(self, comm: Any, local: NDArray[np.float64]) -> NDArray[np.float64]:
        """Collect values at this rank's nodes by node number: (n_nodes, d) on every rank.

        Parameters
        ----------
        comm : mpi4py communicator
            Of the mesh; the call is collective.
        local : array, (n_local_blocks, d)
            Values of owned nodes, then of ghosts, which are left out.
        """
        part, numbers = local[: self.owned], self.node_of_block[: self.owned]
        result = np.zeros((self.total, local.shape[1]))
        if comm.size == 1:
            result[numbers] = part
        else:
            for some_numbers, values in comm.allgather((numbers, part)):
                result[some_numbers] = values
        return result


def node_numbering(mesh: Mesh, blocks: NDArray[np.integer[Any]], owned: int) -> NodeNumbering:
    """Number the blocks of the cells' corners by the nodes of the mesh, on this rank.

    Parameters
    ----------
    mesh : Mesh
    blocks : array of int, (n_cells, n_corners)
        Blocks of the corners of this rank's cells, ghosts included: 0, 1, …, owned ones first.
    owned : int
        Number of blocks that this rank owns.
    """
    number = np.asarray(mesh.domain.geometry.input_global_indices, dtype=np.int64)
    node_of_block = np.empty(int(blocks.max(initial=-1)) + 1, dtype=np.int64)
    node_of_block[blocks] = number[geometry_nodes(mesh.domain)]
    return NodeNumbering(node_of_block, owned, len(mesh.coordinates))
