r"""The load on a body: dead forces, loads that follow it, and a rigid tool.

.. math:: f(u) = f + f_p(u) + f_c(u)

All forces act on the points of the elements: the nodes and, in quadratic elements, those between
them. f in N does not change; :math:`f_p` are those of pressures and cables
(`datagen.solver.following_loads`), and :math:`f_c` those of `datagen.solver.tool_contact`, at the
nodes alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.unknowns import Unknowns
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.following_loads import FollowingLoads
from datagen.solver.supports import Supports
from datagen.solver.tool_contact import ToolContact
from shared_schema.actuators import Control
from shared_schema.common.bodies.following_loads import FollowingLoad
from shared_schema.common.bodies.nodal_forces import scatter_forces, sum_per_node

Array = NDArray[np.float64]


class ActingLoad:
    """Load on the rows that a rank owns.

    Parameters
    ----------
    mesh : Mesh
    unknowns : Unknowns
    supports : Supports
    following : sequence of FollowingLoad
        Pressures and cables. With its corners alone, a pressure acts on the facet that these span.

    Attributes
    ----------
    norm : float
        2-norm of f, and of the given pressures and tensions on the undeformed body, in N.
    following : FollowingLoads or None
        Pressures and cables.
    follow_norm : float
        2-norm of the forces of amplitudes that are not given, when last subtracted, in N.
    contact : ToolContact or None
        Contact with a tool.
    touch_norm : float
        2-norm of the tool's forces when they were last subtracted, in N.
    """

    def __init__(
        self,
        mesh: Mesh,
        unknowns: Unknowns,
        supports: Supports,
        following: Sequence[FollowingLoad],
    ) -> None:
        self._unknowns, self._mesh, self._points = unknowns, mesh, unknowns.points
        nodes, d = mesh.coordinates.shape
        self._shape = (nodes if self._points is None else self._points.count, d)
        self._dofs, self._values = np.empty(0, dtype=np.intp), np.empty(0)
        self._dead = np.zeros(self._shape)
        self.norm = self.touch_norm = self.follow_norm = 0.0
        self.contact: ToolContact | None = None
        self.following: FollowingLoads | None = None
        if len(following):
            x = mesh.coordinates
            self.following = FollowingLoads(
                x if self._points is None else self._points.interpolated(x),
                following,
                *self.rows_and_columns(supports),
            )

    def set(
        self,
        nodes: NDArray[np.int64],
        forces: Array,
        controls: Sequence[Control],
        between: Array | None = None,
    ) -> None:
        """Replace the load (`EquilibriumProblem.set_load`)."""
        points, forces = sum_per_node(nodes, forces)
        if between is not None and self._points is not None:
            of_nodes = scatter_forces(points, forces, self._points.nodes)
            forces = self._points.on_points(of_nodes, between)
            points = np.flatnonzero(forces.any(axis=1))
            forces = forces[points]
        self._dead = scatter_forces(points, forces, self._shape[0])
        positions, blocks = self._unknowns.point_numbering.owned_blocks(points)
        self._dofs = self._unknowns.point_dofs[blocks].ravel().astype(np.intp)
        self._values = np.ascontiguousarray(forces[positions]).ravel()
        self.norm = float(np.linalg.norm(forces))
        if self.following is not None:
            self.following.control(controls)
            at_rest = self.following.forces(np.zeros(self._shape), 1.0)
            self.norm = float(np.hypot(self.norm, np.linalg.norm(at_rest)))

    @property
    def presses(self) -> bool:
        """True if a pressure, cable or tool acts: forces that depend on the displacement."""
        follows = self.following is not None and self.following.acts
        return follows or self.contact is not None

    @property
    def is_bordered(self) -> bool:
        """True if amplitudes of following loads are unknowns."""
        return self.following is not None and len(self.following.unknown) > 0

    def coupled(self) -> list[NDArray[np.intp]]:
        """Entries of this rank's state that each part of a following load couples."""
        if self.following is None:
            return []
        place = np.full(self._shape[0], -1)
        here = self._unknowns.point_numbering.node_of_block
        place[here] = np.arange(len(here))
        at_rest = np.zeros(self._shape)
        found = []
        for points in self.following.coupled(at_rest):
            blocks = place[points]
            found.append(self._unknowns.point_dofs[blocks[blocks >= 0]].ravel().astype(np.intp))
        return found

    def work(self) -> float:
        """Work f · u of the dead forces of this rank at the current state, in J."""
        return float(self._unknowns.state.x.array[self._dofs] @ self._values)

    def dead_forces(self) -> Array:
        """Dead forces on all points: (n_points, d) in N, the same on every rank."""
        return self._dead

    def subtract_forces(self, b: PETSc.Vec, load_factor: float) -> None:
        """Subtract s f from a vector of forces in N."""
        b.array_w[self._dofs] -= load_factor * self._values

    def subtract_following(self, b: PETSc.Vec, load_factor: float, u: Array) -> None:
        """Subtract f_p(u) and f_c(u) of a displacement of all points, (n_points, d) in m."""
        pushed, nodes = np.zeros(self._shape), len(self._mesh.coordinates)
        if self.following is not None:
            pushed += self.following.forces(u, load_factor)
            self.follow_norm = self.following.norm_of_unknown(u)
        if self.contact is not None:
            touch = self.contact.forces(u[:nodes], load_factor)
            self.touch_norm = float(np.linalg.norm(touch))
            pushed[:nodes] += touch
        self.add_to(b, -pushed)

    def add_to(self, b: PETSc.Vec, forces: Array) -> None:
        """Add forces on all points, (n_points, d) in N and the same on every rank, to a vector."""
        numbering = self._unknowns.point_numbering
        of_rank = forces[numbering.node_of_block[: numbering.owned]]
        b.array_w[self._unknowns.point_dofs[: numbering.owned]] += of_rank

    def add_tangent(self, matrix: PETSc.Mat, load_factor: float, u: Array) -> None:
        """Add −∂f_p/∂u − ∂f_c/∂u at a displacement, (n_points, d) in m (collective)."""
        if self.following is not None:
            self.following.add_tangent(matrix, u, load_factor)
        if self.contact is not None:
            self.contact.add_tangent(matrix, u[: len(self._mesh.coordinates)], load_factor)

    def rows_and_columns(self, supports: Supports) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Rows of this rank's points, and columns of all, (n_points, d) each (collective).

        The nodes are the first points. They are -1 where there is no equation; columns of moved
        components are kept.
        """
        numbering, rows = (
            self._unknowns.point_numbering,
            _rows_of_points(self._mesh, self._unknowns),
        )
        owned = np.zeros(self._shape[0], dtype=bool)
        owned[numbering.node_of_block[: numbering.owned]] = True
        fixed, held = supports.fixed, supports.fixed & ~supports.moved
        if self._points is not None:
            fixed, held = self._points.held(fixed), self._points.held(held)
        own_rows = np.where(owned[:, None] & ~fixed, rows, -1)
        columns = np.where(held, -1, rows)
        return own_rows.astype(PETSc.IntType), columns.astype(PETSc.IntType)


def _rows_of_points(mesh: Mesh, unknowns: Unknowns) -> NDArray[np.int64]:
    """Rows of the distributed matrix that belong to every point, (n_points, d) (collective)."""
    dofmap, numbering = unknowns.state.function_space.dofmap, unknowns.point_numbering
    first = dofmap.index_map.local_range[0] * dofmap.index_map_bs
    here = slice(numbering.owned)
    numbers, rows = numbering.node_of_block[here], unknowns.point_dofs[here]
    rows_of_points = np.empty((numbering.total, rows.shape[1]), dtype=np.int64)
    for some, of_some in mesh.domain.comm.allgather((numbers, first + rows)):
        rows_of_points[some] = of_some
    return rows_of_points
