r"""Unknowns of a discretised body: displacements, and with some elements dilations and pressures.

Displacements are those of the *points* of the elements: the corners of the cells and, if they are
quadratic, points between them (`shared_schema.common.bodies.points_between`). Loads act
on all points. Supports and displacements that enter or leave the solver belong to the corners,
which are the nodes of the mesh. At a point between corners, a given field has the value that the
linear shape functions :math:`N_a` of the cell interpolate,

.. math:: u_b = \sum_a N_a(x_b) \, u_a,

and a reaction at such a point counts as the forces :math:`N_a(x_b) f_b` at the corners, which do
the same work.
"""

from __future__ import annotations

from typing import Any

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from datagen.discretisation.element import ElementKind
from datagen.dolfinx_versions import cell_blocks, functionspace, mixed_space
from datagen.mesh.distributed_mesh import Mesh, NodeNumbering, node_numbering
from shared_schema.common.bodies.points_between import NONE, PointsBetween


class Unknowns:
    """State of a body on one rank, and the meaning of its entries.

    Parameters
    ----------
    mesh : Mesh
    kind : ElementKind

    Attributes
    ----------
    state : dolfinx.fem.Function
        All unknowns, in m: entries of this rank, then ghosts.
    cell_dofs : array of int32, (n_owned_cells, n_entries)
        Entries of the state of each cell, in FFCx's order: points of the displacement, component
        by component, then dilations, then pressures.
    numbering : NodeNumbering
        Nodes of the corners, by their blocks.
    dofs : array of int, (n_corners, d)
        Entries of the state of each corner's displacement, in the order of `numbering`.
    points : PointsBetween or None
        All points of the whole mesh, the same on every rank; None if the corners are all.
    point_numbering : NodeNumbering
        Numbers that `points` gives the points, by their blocks; `numbering` if there are none.
    point_dofs : array of int, (n_points, d)
        The same as `dofs` for all points, in the order of `point_numbering`.
    cell_points : array of int, (n_owned_cells, n_points_of_a_cell)
        Numbers of the points of each cell.
    interpolation : sparse array, (n_points, n_corners)
        N_a(x_b) of every point b and corner a of this rank.
    owned : int
        Number of entries that this rank owns.
    """

    def __init__(self, mesh: Mesh, kind: ElementKind) -> None:
        domain = mesh.domain
        d = mesh.coordinates.shape[1]
        if kind.has_pressure:
            space = mixed_space(domain, kind.degree, d, ("Lagrange", 1))
        else:
            space = functionspace(domain, ("Lagrange", kind.degree, (d,)))
        self.state = dolfinx.fem.Function(space, name="displacement")
        index_map, block_size = space.dofmap.index_map, space.dofmap.index_map_bs
        self.owned = index_map.size_local * block_size
        self._has_ghosts = domain.comm.size > 1
        all_dofs = _dofs_of_cells(space)
        owned_cells = domain.topology.index_map(domain.topology.dim).size_local
        self.cell_dofs = all_dofs[:owned_cells]
        weights = _corner_weights(domain, kind.degree)
        count, corners = weights.shape
        at_points = all_dofs[:, : count * d].reshape(-1, count, d)
        self.point_dofs, point_of = _numbered(at_points)
        self.dofs, corner_of = _numbered(at_points[:, :corners])
        owned_corners = int((self.dofs[:, 0] < self.owned).sum())
        self.numbering = node_numbering(mesh, corner_of, owned_corners)
        self.cell_points = point_of[:owned_cells]
        self.interpolation = _interpolation(weights, point_of, corner_of)
        self.points: PointsBetween | None = None
        self.point_numbering = self.numbering
        if not kind.corners_only:
            self.points = PointsBetween.of(mesh.cells, mesh.cell_type, len(mesh.coordinates))
            owned_points = int((self.point_dofs[:, 0] < self.owned).sum())
            self.point_numbering = NodeNumbering(
                self._numbers_of_points(self.points), owned_points, self.points.count
            )

    def _numbers_of_points(self, points: PointsBetween) -> NDArray[np.int64]:
        """Numbers of the points of this rank in those of the whole mesh, by their corners."""
        sizes = np.diff(self.interpolation.indptr)
        nodes = self.numbering.node_of_block[self.interpolation.indices]
        numbers = np.empty(len(sizes), dtype=np.int64)
        numbers[sizes == 1] = nodes[self.interpolation.indptr[:-1][sizes == 1]]
        between = np.flatnonzero(sizes > 1)
        width = np.arange(points.corners.shape[1])
        inside = width < sizes[between, None]
        corners = np.full(inside.shape, NONE)
        at = self.interpolation.indptr[between, None] + width
        corners[inside] = nodes[at[inside]]
        numbers[between] = points.numbers(corners)
        return numbers

    def set_owned(self, values: NDArray[np.float64]) -> None:
        """Set the entries of the state that this rank owns, and of its ghosts (collective)."""
        self.state.x.array[: self.owned] = values
        if self._has_ghosts:
            self.state.x.scatter_forward()

    def set_displacement(self, displacement: NDArray[np.float64]) -> None:
        """Set the displacement from that of the nodes, (n_nodes, d) in m; leave other unknowns."""
        self.state.x.array[self.point_dofs] = self.at_points(displacement)

    def at_points(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Interpolate a displacement of the nodes, (n_nodes, d), at the points: (n_points, d)."""
        return self.interpolation @ displacement[self.numbering.node_of_block]

    def owned_points(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions in m of the points that this rank owns, (n, d), from those of the nodes."""
        positions = self.interpolation @ coordinates[self.numbering.node_of_block]
        return positions[self.point_dofs[:, 0] < self.owned]

    def held(self, components: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Components held at all corners around a point: nodes' (n_nodes, d) → (n_points, d)."""
        free = (~components[self.numbering.node_of_block]).astype(np.float64)
        return np.asarray(self.interpolation @ free == 0.0)


def _dofs_of_cells(space: Any) -> NDArray[np.int32]:
    """Entries of every cell, ghosts included: (n_cells, n_entries)."""
    block_size = space.dofmap.index_map_bs
    blocks = cell_blocks(space)
    dofs = (blocks[:, :, None] * block_size + np.arange(block_size)).reshape(len(blocks), -1)
    return np.ascontiguousarray(dofs, dtype=np.int32)


def _corner_weights(domain: Any, degree: int) -> NDArray[np.float64]:
    """Linear shape functions at the points of a reference cell: (n_points, n_corners)."""
    cell = getattr(basix.CellType, domain.topology.cell_type.name)
    variant = basix.LagrangeVariant.gll_warped
    linear = basix.create_element(basix.ElementFamily.P, cell, 1, variant)
    own = basix.create_element(basix.ElementFamily.P, cell, degree, variant)
    weights = linear.tabulate(0, own.points)[0]
    weights = weights.reshape(len(own.points), -1)
    return np.round(weights, 12)  # halves, quarters and eighths


def _numbered(cell_dofs: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Number the points of the cells by their first entry.

    Parameters
    ----------
    cell_dofs : array of int, (n_cells, n_points, d)

    Returns
    -------
    dofs : array of int, (n, d)
        Entries of every point.
    numbers : array of int, (n_cells, n_points)
        Number of every point of every cell.
    """
    _, index, inverse = np.unique(cell_dofs[..., 0], return_index=True, return_inverse=True)
    return cell_dofs.reshape(-1, cell_dofs.shape[2])[index], inverse.reshape(cell_dofs.shape[:2])


def _interpolation(
    weights: NDArray[np.float64], points: NDArray[np.intp], corners: NDArray[np.intp]
) -> csr_array:
    """N_a(x_b) of all points b (rows) and corners a (columns), each point in one of its cells."""
    count = int(points.max(initial=-1)) + 1
    cell, place = np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp)
    cell[points] = np.arange(len(points))[:, None]
    place[points] = np.arange(points.shape[1])
    width = corners.shape[1]
    matrix = csr_array(
        (weights[place].ravel(), corners[cell].ravel(), width * np.arange(count + 1)),
        shape=(count, int(corners.max(initial=-1)) + 1),
    )
    matrix.eliminate_zeros()
    return matrix
