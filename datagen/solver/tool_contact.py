r"""Frictionless contact of a body with a rigid tool, by augmented Lagrangians.

Every node a of the surface, at :math:`x_a = X_a + u_a`, bears the force

.. math:: f_a = p_a \, n(x_a), \qquad p_a = \max(0, \; λ_a - k_a \, g(x_a))

with the signed distance g of the tool (`shared_schema.tools`) and its normal :math:`n = ∇g`. The
multiplier :math:`λ_a` in N is that of :math:`g(x_a) \ge 0`, the stiffness :math:`k_a` a multiple of
that of the node at rest. After Newton's method has found the equilibrium, each λ becomes its p, and
so on (Wriggers, *Computational Contact Mechanics*, 2006, Section 5.3.4); what remains of the
penetration is reported. The part of the tangent, :math:`k_a n n^T - p_a ∇^2 g` where p > 0, is
symmetric. The load factor s moves the tool's surface by :math:`(1 - s) \, g_0` into the tool, with
the depth :math:`g_0` in which the undeformed body overlaps it, so that nothing is touched at s = 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from shared_schema.common.errors import InputError
from shared_schema.tools import Tool

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem

Array = NDArray[np.float64]
STIFFNESS = 1.0  # k over the largest entry of the node's diagonal of K at rest


class ToolContact:
    """Contact of the surface of a body, which may be distributed over ranks.

    Every rank looks at all nodes and keeps the rows of its own.

    Parameters
    ----------
    tool : Tool
    coordinates : array, (n_nodes, d)
        Undeformed positions in m, the same on every rank.
    nodes : array of int, (n,)
        Nodes of the surface that can move.
    stiffness : array, (n,)
        k in N/m.
    rows, columns : array of int, (n_nodes, d)
        Rows of the matrix, and its columns, of every node; -1 where they are not to be changed.

    Attributes
    ----------
    multipliers : array, (n,)
        λ in N.
    depth : float
        g₀ in m.
    """

    def __init__(
        self,
        tool: Tool,
        coordinates: Array,
        nodes: NDArray[np.int64],
        stiffness: Array,
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
    ) -> None:
        self.tool, self._coordinates, self.nodes = tool, coordinates, nodes
        self._stiffness, self._rows, self._columns = stiffness, rows, columns
        self.multipliers, self.smoothing = np.zeros(len(nodes)), 0.0
        self.depth = self.penetration(np.zeros_like(coordinates))

    def penetration(self, u: Array) -> float:
        """Largest depth of a node inside the tool, of a displacement (n_nodes, d), in m."""
        return max(0.0, -float(self.tool.gap(self._positions(u)).min()))

    def forces(self, u: Array, factor: float = 1.0) -> Array:
        """Forces of the tool on the nodes: (n_nodes, d) in m → same in N."""
        x = self._positions(u)
        total = np.zeros(self._coordinates.shape)
        total[self.nodes] = self._sizes(x, factor)[:, None] * self.tool.normal(x)
        return total

    def add_tangent(self, matrix: PETSc.Mat, u: Array, factor: float) -> None:
        """Add the derivative of −`forces` to a matrix (collective)."""
        x = self._positions(u)
        n, bent = self.tool.normal(x), self.tool.curvature(x)
        p, slope = self._smoothed(x, factor)
        blocks = (slope * self._stiffness)[:, None, None] * n[:, :, None] * n[:, None, :]
        blocks = blocks - p[:, None, None] * bent
        for number in np.flatnonzero(p > 0):
            node = self.nodes[number]
            where = self._rows[node], self._columns[node]
            matrix.setValues(*where, blocks[number], addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def update(self, u: Array) -> None:
        """Let every λ be the p of an equilibrium."""
        self.multipliers = self._sizes(self._positions(u), 1.0)

    def _positions(self, u: Array) -> Array:
        return np.asarray((self._coordinates + u)[self.nodes])

    def _sizes(self, x: Array, factor: float) -> Array:
        """Sizes p of the forces in N."""
        return self._smoothed(x, factor)[0]

    def _smoothed(self, x: Array, factor: float) -> tuple[Array, Array]:
        """Sizes of the forces in N, and the part of k by which they grow with the penetration."""
        gap = self.tool.gap(x) + (1 - factor) * self.depth
        pushed, width = self.multipliers - self._stiffness * gap, self._stiffness * self.smoothing
        root = np.hypot(pushed, 2 * width)
        slope = np.divide(pushed, root, out=np.zeros_like(pushed), where=root > 0)
        return (pushed + root) / 2, (1 + slope) / 2


def touched(problem: EquilibriumProblem, tool: Tool, surface: NDArray[np.int64]) -> ToolContact:
    """Let a tool touch the body of a problem (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
        At rest.
    tool : Tool
    surface : array of int, (n,)
        Nodes of the surface.

    Raises
    ------
    InputError
        If the tool overlaps nodes that are wholly held, or has the body all inside.
    """
    coordinates, supports = problem.mesh.coordinates, problem.supports
    held = surface[supports.fixed[surface].all(axis=1)]
    if len(held) and tool.gap(coordinates[held]).min() < 0:
        raise InputError("the tool overlaps nodes that are held, expected it elsewhere")
    if tool.gap(coordinates).max() < 0:
        raise InputError("the whole body lies inside the tool")
    diagonal = np.zeros(len(problem.u.x.array))
    diagonal[: problem.unknowns.owned] = problem.tangent().getDiagonal().array_r
    of_corners = problem.unknowns.forces_at_corners(diagonal)
    of_nodes = problem.numbering.gathered(problem.comm, of_corners, add=True)
    nodes = surface[~supports.fixed[surface].all(axis=1)]
    rows, columns = problem.load.rows_and_columns(supports)
    stiffness = STIFFNESS * np.where(supports.fixed, 0.0, of_nodes)[nodes].max(axis=1)
    return ToolContact(tool, coordinates, nodes, stiffness, rows, columns)
