"""Map between the node numbers of a mesh and the degrees of freedom of a vector space on it.

dolfinx renumbers the nodes when it distributes a mesh. Everything that enters or leaves the solver
uses the numbers of the source mesh ("node numbers"); `NodeNumbering` converts between the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.dolfinx_versions import geometry_nodes
from datagen.mesh.distributed_mesh import Mesh


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
