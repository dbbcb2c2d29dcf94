r"""The load on a body: dead forces, pressures that follow the surface, and a rigid tool.

.. math:: f(u) = f + f_p(u) + f_c(u)

All forces act on the points of the elements: the nodes and, in quadratic elements, those between
them. f in N does not change; :math:`f_c` is that of `datagen.solver.tool_contact`, at the nodes
alone. A pressure follows the deformed surface:

.. math:: f_{p,a}(u) = -p \int_{Γ(u)} N_a \, n \, dS

and its derivative with respect to u, which the tangent of the body lacks, are those of
`shared_schema.common.bodies.distributed_loads`. A facet of a quadratic element is deformed with all
its points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.unknowns import Unknowns
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.supports import Supports
from datagen.solver.tool_contact import ToolContact
from shared_schema.common.bodies.distributed_loads import facet_derivatives, pressure_forces
from shared_schema.common.bodies.nodal_forces import scatter_forces, sum_per_node

Array = NDArray[np.float64]


class FollowerPressure:
    """Pressures on surfaces of a body that may be distributed over ranks.

    Every rank looks at all facets and keeps the rows of its own points.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Undeformed positions of the points of the elements in m, the same on every rank.
    surfaces : sequence of array of int, (n_facets, n_points of a facet)
        Facets of every surface by numbers of points, seen from outside.
    rows, columns : array of int, (n_points, d)
        Rows of the matrix, and its columns, of every point; -1 where they are not to be changed.

    Attributes
    ----------
    pressures : array, (n_surfaces,)
        Pressure on each surface in Pa.
    """

    def __init__(
        self,
        coordinates: Array,
        surfaces: Sequence[NDArray[np.int64]],
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
    ) -> None:
        self._coordinates, self._surfaces = coordinates, surfaces
        self.pressures = np.zeros(len(surfaces))
        self._rows, self._columns = rows, columns

    def forces(self, u: Array) -> Array:
        """Forces of the full pressures at a displacement in m: (n_points, d) in N."""
        total = np.zeros(u.shape)
        for facets, pressure in zip(self._surfaces, self.pressures, strict=True):
            if pressure:
                total += pressure_forces(self._coordinates + u, facets, pressure)
        return total

    def add_tangent(self, matrix: PETSc.Mat, u: Array, factor: float) -> None:
        """Add the derivative of −factor · `forces` to the matrix (collective)."""
        for facets, pressure in zip(self._surfaces, self.pressures, strict=True):
            if pressure:
                blocks = -factor * facet_derivatives(self._coordinates + u, facets, pressure)
                for points, block in zip(facets, blocks, strict=True):
                    rows, columns = self._rows[points].ravel(), self._columns[points].ravel()
                    matrix.setValues(rows, columns, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()


class ActingLoad:
    """Load on the rows that a rank owns.

    Parameters
    ----------
    mesh : Mesh
    unknowns : Unknowns
    supports : Supports
    surfaces : sequence of array of int, (n_facets, n_points of a facet)
        Facets under pressures, by numbers of points and seen from outside; with their corners
        alone, a pressure acts on the facets that these span.

    Attributes
    ----------
    norm : float
        2-norm of f, and of the pressures' forces on the undeformed body, in N.
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
        surfaces: Sequence[NDArray[np.int64]],
    ) -> None:
        self._unknowns, self._mesh, self._points = unknowns, mesh, unknowns.points
        nodes, d = mesh.coordinates.shape
        self._shape = (nodes if self._points is None else self._points.count, d)
        self._dofs, self._values = np.empty(0, dtype=np.intp), np.empty(0)
        self.norm = self.touch_norm = 0.0
        self.contact: ToolContact | None = None
        self._pressure: FollowerPressure | None = None
        if len(surfaces):
            x = mesh.coordinates
            self._pressure = FollowerPressure(
                x if self._points is None else self._points.interpolated(x),
                surfaces,
                *self.rows_and_columns(supports),
            )

    def set(
        self,
        nodes: NDArray[np.int64],
        forces: Array,
        pressures: Array | None,
        between: Array | None = None,
    ) -> None:
        """Replace the load (`EquilibriumProblem.set_load`)."""
        points, forces = sum_per_node(nodes, forces)
        if between is not None and self._points is not None:
            of_nodes = scatter_forces(points, forces, self._points.nodes)
            forces = self._points.on_points(of_nodes, between)
            points = np.flatnonzero(forces.any(axis=1))
            forces = forces[points]
        positions, blocks = self._unknowns.point_numbering.owned_blocks(points)
        self._dofs = self._unknowns.point_dofs[blocks].ravel().astype(np.intp)
        self._values = np.ascontiguousarray(forces[positions]).ravel()
        self.norm = float(np.linalg.norm(forces))
        if self._pressure is not None:
            self._pressure.pressures[:] = 0.0 if pressures is None else pressures
            if self._pressure.pressures.any():
                at_rest = self._pressure.forces(np.zeros(self._shape))
                self.norm = float(np.hypot(self.norm, np.linalg.norm(at_rest)))

    @property
    def presses(self) -> bool:
        """True if a pressure or a tool acts: forces that depend on the displacement."""
        pressed = self._pressure is not None and bool(self._pressure.pressures.any())
        return pressed or self.contact is not None

    def work(self) -> float:
        """Work f · u of the dead forces of this rank at the current state, in J."""
        return float(self._unknowns.state.x.array[self._dofs] @ self._values)

    def subtract_forces(self, b: PETSc.Vec, load_factor: float) -> None:
        """Subtract s f from a vector of forces in N."""
        b.array_w[self._dofs] -= load_factor * self._values

    def subtract_pressures(self, b: PETSc.Vec, load_factor: float, u: Array) -> None:
        """Subtract s f_p(u) and f_c(u) of a displacement of all points, (n_points, d) in m."""
        numbering, pushed = self._unknowns.point_numbering, np.zeros(self._shape)
        nodes = len(self._mesh.coordinates)
        if self._pressure is not None:
            pushed += load_factor * self._pressure.forces(u)
        if self.contact is not None:
            touch = self.contact.forces(u[:nodes], load_factor)
            self.touch_norm = float(np.linalg.norm(touch))
            pushed[:nodes] += touch
        of_rank = pushed[numbering.node_of_block[: numbering.owned]]
        b.array_w[self._unknowns.point_dofs[: numbering.owned]] -= of_rank

    def add_tangent(self, matrix: PETSc.Mat, load_factor: float, u: Array) -> None:
        """Add −s ∂f_p/∂u − ∂f_c/∂u at a displacement, (n_points, d) in m (collective)."""
        if self._pressure is not None:
            self._pressure.add_tangent(matrix, u, load_factor)
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
