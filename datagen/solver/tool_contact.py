r"""Frictionless contact of a body with a rigid tool, as a set of nodes that are held by forces.

Every node a of the surface, at :math:`x_a = X_a + u_a`, keeps out of the tool, and bears a force
along the normal :math:`n = ∇g` of its signed distance g (`shared_schema.tools`):

.. math:: f_a = λ_a \, n(x_a), \qquad g(x_a) \ge 0, \quad λ_a \ge 0, \quad λ_a \, g(x_a) = 0.

Newton's method solves this with the equilibrium, by active sets (Alart and Curnier 1991, *Comput.
Methods Appl. Mech. Engrg.* 92; Hüeber and Wohlmuth 2005, *ibid.* 194). At an iterate a node is
active if :math:`λ_a - c_a \, g > 0`. Its force is then :math:`λ_a - k_a \, g`, and that at the next
iterate, which becomes λ, is linearised:

.. math:: λ_a ← λ_a - k_a \, (g + n · Δu_a), \qquad
    K ← K + k_a \, n n^T - (λ_a - k_a g) \, ∇^2 g.

λ of all other nodes is 0. The numbers c and k are multiples of the stiffness of the node at rest;
the equilibrium does not depend on them, since λ changes until g = 0. The load factor s moves the
tool's surface by :math:`(1 - s) \, g_0` into the tool, with the depth :math:`g_0` in which the
undeformed body overlaps it, so that nothing is touched at s = 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from shared_schema.tools import Contact, Tool, require_outside

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem

Array = NDArray[np.float64]
STIFFNESS = 100.0  # k over the largest entry of the node's diagonal of K at rest
COMPLEMENT = 0.1  # c over the same
INSIDE = 1e-6  # of the body's size: depth of a node that is an error
ROUNDING = 0.5 * float(np.finfo(float).eps)


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
    diagonal : array, (n,)
        Their stiffness at rest in N/m.
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
        diagonal: Array,
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
    ) -> None:
        self.tool, self._coordinates, self.nodes = tool, coordinates, nodes
        self._k, self._c = STIFFNESS * diagonal, COMPLEMENT * diagonal
        self._rows, self._columns = rows, columns
        self.multipliers = np.zeros(len(nodes))
        self.depth = max(0.0, -float(tool.gap(coordinates[nodes]).min()))
        self._rounding = ROUNDING * max(tool.size, float(np.abs(coordinates).max()))
        self._bears = np.zeros(len(nodes), dtype=bool)
        self._at: tuple[Array, Array, Array] | None = None  # positions, sizes, normals

    @property
    def round_off(self) -> float:
        """What rounding of distances leaves of the last forces, in N: ε of lengths, times ‖k‖₂."""
        return self._rounding * float(np.linalg.norm(self._k[self._bears]))

    def penetration(self, u: Array) -> float:
        """Largest depth of a node inside the tool, of a displacement (n_nodes, d), in m."""
        return max(0.0, -float(self.tool.gap(self._coordinates + u).min()))

    def forces(self, u: Array, factor: float = 1.0) -> Array:
        """Forces of the tool on the nodes, (n_nodes, d) in m → same in N.

        At the iterate after that of `add_tangent`, λ changes.
        """
        x = self._positions(u)
        if self._at is not None and not np.array_equal(x, self._at[0]):
            before, sizes, n = self._at
            step = ((x - before) * n).sum(axis=1)
            self.multipliers = np.where(sizes != 0, sizes - self._k * step, 0.0)
            self._at = None
        total = np.zeros(self._coordinates.shape)
        sizes = self._sizes(x, factor)
        total[self.nodes] = sizes[:, None] * self.tool.normal(x)
        self._bears = sizes != 0
        return total

    def add_tangent(self, matrix: PETSc.Mat, u: Array, factor: float) -> None:
        """Add the derivative of −`forces` to a matrix (collective)."""
        x = self._positions(u)
        sizes, n, bent = self._sizes(x, factor), self.tool.normal(x), self.tool.curvature(x)
        self._at = x, sizes, n
        blocks = self._k[:, None, None] * n[:, :, None] * n[:, None, :]
        blocks = blocks - sizes[:, None, None] * bent
        for number in np.flatnonzero(sizes):
            node = self.nodes[number]
            where = self._rows[node], self._columns[node]
            matrix.setValues(*where, blocks[number], addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def found(self, u: Array) -> Contact:
        """Describe the contact in an equilibrium, (n_nodes, d) in m."""
        return Contact(self.forces(u), self.penetration(u))

    def state(self) -> Array:
        """Copy λ."""
        return self.multipliers.copy()

    def restore(self, multipliers: Array) -> None:
        """Set λ to a copy."""
        self.multipliers, self._at = multipliers.copy(), None

    def _positions(self, u: Array) -> Array:
        return np.asarray((self._coordinates + u)[self.nodes])

    def _sizes(self, x: Array, factor: float) -> Array:
        """Sizes of the forces of the active nodes in N, else 0."""
        gap = self.tool.gap(x) + (1 - factor) * self.depth
        active = self.multipliers - self._c * gap > 0
        return np.where(active, self.multipliers - self._k * gap, 0.0)


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
    require_outside(tool, coordinates, ~supports.fixed)
    diagonal = np.zeros(len(problem.u.x.array))
    at_rest = problem.tangent().getDiagonal()
    diagonal[: problem.unknowns.owned] = at_rest.array_r
    at_rest.destroy()
    of_corners = problem.unknowns.forces_at_corners(diagonal)
    of_nodes = problem.numbering.gathered(problem.comm, of_corners, add=True)
    nodes = surface[~supports.fixed[surface].all(axis=1)]
    rows, columns = problem.load.rows_and_columns(supports)
    stiffness = np.where(supports.fixed, 0.0, of_nodes)[nodes].max(axis=1)
    return ToolContact(tool, coordinates, nodes, stiffness, rows, columns)
