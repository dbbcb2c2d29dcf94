r"""Contact of a body with a rigid tool, as a set of nodes that are held by forces.

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
the equilibrium does not depend on them, since λ changes until g = 0. Forces of friction, if there
are any, add to these.

The load factor s moves the tool along its way. Without a way, it
moves the tool's surface by :math:`(1 - s) \, g_0` into the tool, with the depth :math:`g_0` in
which the undeformed body overlaps it, so that nothing is touched at s = 0.

The tool is displaced from its place by :math:`a(s)`, which goes along straight lines from the first
given point over all others to 0, and has gone the part s of their length at the load factor s. A
position x of the body is at :math:`x - a(s)` in the frame of the tool.

Friction is Coulomb's. In the frame of the tool a node has slipped by :math:`w = P (y - y_0)` since
the last equilibrium, with its positions y there and now, and :math:`P = I - n n^T`. It bears a
force f in the tangent plane, at most μ times the size N of its normal force, which opposes the
slip:

.. math:: |f| \le μ N, \qquad w = -α f, \quad α \ge 0, \quad α \, (|f| - μ N) = 0.

At an iterate of Newton's method, with the multiplier τ, :math:`q = P τ - c \, w` and the estimate
:math:`\bar N = λ - c \, g` of the contact,

.. math::
    f = P τ - k \, w \quad \text{(stick)} \quad \text{if } |q| \le μ \bar N, \qquad
    f = μ N \, t - σ A \, w \quad \text{(slip)} \quad \text{else},

with :math:`N = λ - k \, g`, :math:`t = q / |q|` and :math:`A = P - t t^T`. The force at the next
iterate, linearised, becomes τ. In slip it is that of the linearised law
:math:`τ = μ N \, (τ - c w) / |τ - c w|`, from which :math:`σ = μ \bar N c / (|q| - μ \bar N)`
follows, at most k (Alart and Curnier 1991, *Comput. Methods Appl. Mech. Engrg.* 92). Neither c nor
k changes the equilibrium, in which w = 0 where nodes stick, and A w = 0 where they slip.

The law is one of rates: slips are those from one load step to the next, by the backward Euler
method, so that the equilibrium depends on the tool's way and, to first order, on the load steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from shared_schema.common.errors import InputError
from shared_schema.tools import Contact, Tool, require_outside

if TYPE_CHECKING:
    from datagen.solver.equilibrium import EquilibriumProblem

Array = NDArray[np.float64]
STIFFNESS = 100.0  # k over the largest entry of the node's diagonal of K at rest
COMPLEMENT = 0.1  # c over the same
INSIDE = 1e-6  # of the body's size: depth of a node that is an error
ROUNDING = 0.5 * float(np.finfo(float).eps)


class Touching(NamedTuple):
    """What the contact says of the nodes of a surface at an iterate.

    Attributes
    ----------
    positions : array, (n, d)
        In the frame of the tool in m.
    normal : array, (n, d)
        n.
    sizes : array, (n,)
        N in N; 0 where a node bears no force.
    estimates : array, (n,)
        Estimates of N in N, positive where a node bears a force.
    """

    positions: Array
    normal: Array
    sizes: Array
    estimates: Array


class _Trial(NamedTuple):
    """w, P τ and t, (n, d); A, (n, d, d); whether nodes slip, and σ, (n,)."""

    slip: Array
    tau: Array
    along: Array
    across: Array
    slides: NDArray[np.bool_]
    turning: Array


class Friction:
    """Friction of the nodes of a surface.

    Parameters
    ----------
    coefficient : float
        μ.
    stick, complement : array, (n,)
        k and c in N/m.
    positions : array, (n, d)
        In the frame of the tool in m, at rest.

    Attributes
    ----------
    multipliers : array, (n, d)
        τ in N.
    """

    def __init__(
        self, coefficient: float, stick: Array, complement: Array, positions: Array
    ) -> None:
        self.coefficient, self._k, self._c = coefficient, stick, complement
        self._settled = positions.copy()
        self.multipliers = np.zeros_like(positions)

    def forces(self, at: Touching) -> Array:
        """Forces in N, (n, d)."""
        trial = self._trial(at)
        across = np.einsum("nij,nj->ni", trial.across, trial.slip)
        sliding = self.coefficient * at.sizes[:, None] * trial.along
        sliding = sliding - trial.turning[:, None] * across
        sticking = trial.tau - self._k[:, None] * trial.slip
        found = np.where(trial.slides[:, None], sliding, sticking)
        return np.where(at.sizes[:, None] != 0, found, 0.0)

    def tangents(self, at: Touching, normal_stiffness: Array) -> Array:
        """Derivative of −`forces` by the positions, (n, d, d); that of N is −k n of the contact."""
        trial, n = self._trial(at), at.normal
        growing = (self.coefficient * normal_stiffness)[:, None, None]
        sliding = growing * trial.along[:, :, None] * n[:, None, :]
        sliding = sliding + trial.turning[:, None, None] * trial.across
        sticking = self._k[:, None, None] * _planes(n)
        found = np.where(trial.slides[:, None, None], sliding, sticking)
        return np.where((at.sizes != 0)[:, None, None], found, 0.0)

    def settle(self, positions: Array, forces: Array) -> None:
        """Take an equilibrium as the one from which slips count."""
        self._settled, self.multipliers = positions.copy(), forces.copy()

    def _trial(self, at: Touching) -> _Trial:
        planes = _planes(at.normal)
        slip = np.einsum("nij,nj->ni", planes, at.positions - self._settled)
        tau = np.einsum("nij,nj->ni", planes, self.multipliers)
        q, limit = tau - self._c[:, None] * slip, self.coefficient * at.estimates
        length = np.linalg.norm(q, axis=1)
        along = q / np.where(length > 0, length, 1.0)[:, None]
        slides = length > limit
        beyond = np.where(slides, length - limit, 1.0)
        turning = np.minimum(limit * self._c / beyond, self._k)
        across = planes - along[:, :, None] * along[:, None, :]
        return _Trial(slip, tau, along, across, slides, turning)


def _planes(normal: Array) -> Array:
    """P, (n, d, d)."""
    return np.asarray(np.eye(normal.shape[1]) - normal[:, :, None] * normal[:, None, :])


class Way:
    """Way of a tool.

    Parameters
    ----------
    points : array, (n, d)
        Displacements of the tool from its place in m, in turn; none if it does not move.

    Attributes
    ----------
    length : float
        In m.
    """

    def __init__(self, points: Array) -> None:
        self._points = np.concatenate([points, np.zeros((1, points.shape[1]))])
        lengths = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
        reached = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(reached[-1])
        self._parts = reached / reached[-1] if reached[-1] > 0 else reached

    def at(self, factor: float) -> Array:
        """Displacement a(s) of the tool from its place in m, (d,)."""
        if self.length == 0:
            return np.asarray(self._points[-1])
        return np.array([np.interp(factor, self._parts, axis) for axis in self._points.T])


def require_free_begin(way: Way, tool: Tool, coordinates: Array) -> None:
    """Raise InputError if a tool overlaps nodes of the undeformed body where its way begins."""
    depth = -float(tool.gap(coordinates - way.at(0.0)).min())
    if depth > 0:
        raise InputError(
            f"the tool's way begins {depth:.3g} m inside the body, expected it outside"
        )


class _Iterate(NamedTuple):
    """The nodes at an iterate, their forces of friction (n, d), and their tangents (n, d, d)."""

    touching: Touching
    friction: Array
    tangents: Array


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
    rows, columns : array of int, (n_nodes or more, d)
        Rows of the matrix, and its columns, of every node; -1 where they are not to be changed.
    friction : float
        Coefficient μ.
    way : array, (n_points, d)
        Displacements of the tool from its place in m, where it comes from (`Way`); none without.

    Attributes
    ----------
    multipliers : array, (n,)
        λ in N.
    depth : float
        g₀ in m.
    friction : Friction or None
    """

    def __init__(
        self,
        tool: Tool,
        coordinates: Array,
        nodes: NDArray[np.int64],
        diagonal: Array,
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
        friction: float,
        way: Array,
    ) -> None:
        self.tool, self._coordinates, self.nodes = tool, coordinates, nodes
        self._k, self._c = STIFFNESS * diagonal, COMPLEMENT * diagonal
        self._rows, self._columns = rows, columns
        self.multipliers = np.zeros(len(nodes))
        self._way = Way(way)
        overlap = -float(tool.gap(coordinates[nodes]).min())
        self.depth = 0.0 if len(way) else max(0.0, overlap)
        self.friction: Friction | None = None
        if friction:
            begin = coordinates[nodes] - self._way.at(0.0)
            self.friction = Friction(friction, self._k, self._c, begin)
        self._rounding = ROUNDING * max(tool.size, float(np.abs(coordinates).max()))
        self._bears = np.zeros(len(nodes), dtype=bool)
        self._at: _Iterate | None = None  # of the last tangent

    @property
    def way_length(self) -> float:
        """How far the tool, or its surface as it grows, goes from s = 0 to 1, in m."""
        return self._way.length + self.depth

    @property
    def round_off(self) -> float:
        """What rounding of distances leaves of the last forces, in N: ε of lengths, times ‖k‖₂."""
        return self._rounding * float(np.linalg.norm(self._k[self._bears]))

    def penetration(self, u: Array, factor: float = 1.0) -> float:
        """Largest depth of a node inside the tool, of a displacement (n_nodes, d), in m."""
        away = self._coordinates + u - self._way.at(factor)
        gap = self.tool.gap(away) + (1 - factor) * self.depth
        return max(0.0, -float(gap.min()))

    def forces(self, u: Array, factor: float = 1.0) -> Array:
        """Forces of the tool on the nodes, (n_nodes, d) in m → same in N.

        At the iterate after that of `add_tangent`, λ and τ change.
        """
        x = self._positions(u, factor)
        if self._at is not None and not np.array_equal(x, self._at.touching.positions):
            self._update(*self._at, x)
            self._at = None
        total = np.zeros(self._coordinates.shape)
        at = self._touching(x, factor)
        total[self.nodes] = at.sizes[:, None] * at.normal
        if self.friction is not None:
            total[self.nodes] += self.friction.forces(at)
        self._bears = at.sizes != 0
        return total

    def _update(self, before: Touching, rubbed: Array, tangents: Array, x: Array) -> None:
        """Let the linearised forces at the next iterate, at positions x, be λ and τ."""
        step = x - before.positions
        sizes = before.sizes - self._k * (step * before.normal).sum(axis=1)
        self.multipliers = np.where(before.sizes != 0, sizes, 0.0)
        if self.friction is not None:
            self.friction.multipliers = rubbed - np.einsum("nij,nj->ni", tangents, step)

    def add_tangent(self, matrix: PETSc.Mat, u: Array, factor: float) -> None:
        """Add the derivative of −`forces` to a matrix (collective)."""
        x = self._positions(u, factor)
        at = self._touching(x, factor)
        n, bent = at.normal, self.tool.curvature(x)
        blocks = self._k[:, None, None] * n[:, :, None] * n[:, None, :]
        blocks = blocks - at.sizes[:, None, None] * bent
        rubbed, tangents = np.zeros_like(x), np.zeros_like(bent)
        if self.friction is not None:
            rubbed, tangents = self.friction.forces(at), self.friction.tangents(at, self._k)
        self._at = _Iterate(at, rubbed, tangents)
        blocks += tangents
        for number in np.flatnonzero(at.sizes):
            node = self.nodes[number]
            where = self._rows[node], self._columns[node]
            matrix.setValues(*where, blocks[number], addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()

    def settle(self, u: Array, factor: float) -> None:
        """Take a displacement, (n_nodes, d) in m, as an equilibrium from which slips count."""
        if self.friction is not None:
            at = self._touching(self._positions(u, factor), factor)
            self.friction.settle(at.positions, self.friction.forces(at))

    def found(self, u: Array, factor: float = 1.0) -> Contact:
        """Describe the contact in an equilibrium, (n_nodes, d) in m."""
        return Contact(self.forces(u, factor), self.penetration(u, factor))

    def state(self) -> tuple[Array, Array | None]:
        """Copy λ and τ."""
        rubs = self.friction
        return self.multipliers.copy(), None if rubs is None else rubs.multipliers.copy()

    def restore(self, state: tuple[Array, Array | None]) -> None:
        """Set λ and τ to copies."""
        multipliers, rubbing = state
        self.multipliers, self._at = multipliers.copy(), None
        if self.friction is not None and rubbing is not None:
            self.friction.multipliers = rubbing.copy()

    def _positions(self, u: Array, factor: float) -> Array:
        """Positions of the nodes of the surface in the frame of the tool, (n, d) in m."""
        return np.asarray((self._coordinates + u)[self.nodes] - self._way.at(factor))

    def _touching(self, x: Array, factor: float) -> Touching:
        """Forces of the active nodes at positions in the frame of the tool."""
        gap = self.tool.gap(x) + (1 - factor) * self.depth
        estimates = self.multipliers - self._c * gap
        sizes = np.where(estimates > 0, self.multipliers - self._k * gap, 0.0)
        return Touching(x, self.tool.normal(x), sizes, np.maximum(estimates, 0.0))


def touched(
    problem: EquilibriumProblem,
    tool: Tool,
    surface: NDArray[np.int64],
    friction: float = 0.0,
    way: Array | None = None,
) -> ToolContact:
    """Let a tool touch the body of a problem (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
        At rest.
    tool : Tool
    surface : array of int, (n,)
        Nodes of the surface.
    friction : float
        Coefficient μ; it needs a way.
    way : array, (n_points, d), optional
        Displacements of the tool from its place in m, where it comes from.

    Raises
    ------
    InputError
        If the tool overlaps nodes that are wholly held, has the body all inside, or its way begins
        in the body; if there is friction, and no way.
    """
    coordinates, supports = problem.mesh.coordinates, problem.supports
    require_outside(tool, coordinates, ~supports.fixed)
    points = np.zeros((0, coordinates.shape[1])) if way is None else way
    if len(points):
        require_free_begin(Way(points), tool, coordinates)
    elif friction:
        raise InputError("friction depends on the tool's way, expected where it comes from")
    diagonal = np.zeros(len(problem.u.x.array))
    at_rest = problem.tangent().getDiagonal()
    diagonal[: problem.unknowns.owned] = at_rest.array_r
    at_rest.destroy()
    unknowns = problem.unknowns
    of_nodes = unknowns.point_numbering.gathered(problem.comm, diagonal[unknowns.point_dofs])
    if unknowns.points is not None:
        of_nodes = unknowns.points.on_nodes(of_nodes)
    nodes = surface[~supports.fixed[surface].all(axis=1)]
    stiffness = np.where(supports.fixed, 0.0, of_nodes)[nodes].max(axis=1)
    where = problem.load.rows_and_columns(supports)
    return ToolContact(tool, coordinates, nodes, stiffness, *where, friction, points)
