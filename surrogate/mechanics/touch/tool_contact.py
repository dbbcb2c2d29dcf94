r"""Contact of a body with a rigid tool: Newton's method around complementarity problems.

Around a state with forces f of the tool at positions x, displacements are :math:`δx = C \, δf`
(`surrogate.mechanics.touch.loaded_body`). Sought is

.. math:: f_a = λ_a \, n(x_a), \qquad g(x_a) \ge 0, \quad λ_a \ge 0, \quad λ_a \, g(x_a) = 0,

with the distance g of the tool, its gradient n and Hessian H (`shared_schema.tools`). A step of
Newton's method is

.. math:: δf = (I - Λ H C)^{-1} (λ n - f + n \, δλ), \qquad
          0 \le λ + δλ \;⊥\; g + n^T C \, δf \ge 0,

a linear complementarity problem of the nodes near the tool.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.tools import Tool
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.touch.condition import Condition, solve_complementarity
from surrogate.mechanics.touch.loaded_body import LinearBody

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

STEPS = 25  # of Newton's method
SETTLED, DEEP, REACH = 1e-4, 1e-6, 0.1  # over the body's size: movement of the last step; depth
# of a node; distance of nodes that are looked at


@dataclass(frozen=True)
class ToolContact(Condition):
    """No node of a surface is inside a tool, and none is apart from it that bears a force.

    Attributes
    ----------
    tool : Tool
    at_rest : array, (n, d)
        Undeformed positions of the nodes in m, whose components, (n d,), are in order.
    back : float
        Length in m by which the surface of the tool is withdrawn.
    settled : float
        Movement of the last step towards linear contact, over the size of the body; one more would
        be as its square.
    """

    tool: Tool
    at_rest: Array
    back: float = 0.0
    settled: float = SETTLED
    missing = "no equilibrium with the tool is found: it enters the body by {:.0%} of its depth"

    def positions(self, u: Array) -> Array:
        """Positions of the nodes in m, (n, d)."""
        return self.at_rest + u.reshape(self.at_rest.shape)

    def depth(self, u: Array) -> float:
        """Largest depth of a node in m."""
        return max(0.0, -float(self.tool.gap(self.positions(u)).min()))

    def bears(self, force: Array) -> NDArray[np.bool_]:
        """Nodes that bear a force, (n,)."""
        return np.asarray(force.reshape(self.at_rest.shape).any(axis=1))

    def wrong(self, u: Array, force: Array) -> float:
        """Largest depth of a node, or distance of one that bears a force."""
        gap = self.tool.gap(self.positions(u)) + self.back
        apart = float(np.abs(gap[self.bears(force)]).max(initial=0.0))
        return max(0.0, -float(gap.min()), apart)

    def size(self, field: Array, wrong: float) -> float:
        """Return the largest displacement."""
        return float(np.abs(field).max())

    def felt(self, body: LinearBody, change: Array, u: Array, force: Array) -> float:
        """Return the largest change where nodes bear forces, over the displacement there.

        The tool is rigid: the forces would change by about that part.
        """
        bears = self.bears(force)
        of_nodes = (values.reshape(self.at_rest.shape)[bears] for values in (change, u))
        moved, size = map(longest, of_nodes)
        return moved / (size or 1.0)

    def on_the_way(self, share: float, u: Array) -> ToolContact:
        """Withdraw the tool by a part of its depth."""
        return replace(self, back=(1 - share) * self.depth(u))

    def moved_from(self, last: ToolContact | None, u: Array, force: Array) -> Array:
        """Changes of the distances to nodes that bear forces."""
        bears, moved = self.bears(force), np.zeros(self.at_rest.shape)
        if last is not None:
            x = self.positions(u)[bears]
            moved[bears, 0] = self.tool.gap(x) - last.tool.gap(x)
        return moved.ravel()

    def forces(self, body: LinearBody, u: Array, force: Array) -> Array | None:
        """Forces of the tool on the linear body."""
        x, acting, tool = self.positions(u), force.reshape(self.at_rest.shape), self.tool
        size, gap = float(np.ptp(self.at_rest, axis=0).max()), tool.gap(x) + self.back
        bears = self.bears(force)
        close = np.flatnonzero(bears | (gap < REACH * size))
        acts = bears[close]
        near = acts | (gap[close] < min(float(gap.min()) / 2, 0.0))
        total, at, gap, sizes = acting[close], x[close], gap[close], np.zeros(len(close))
        sizes[acts] = np.maximum((total[acts] * tool.normal(at[acts])).sum(axis=1), 0.0)
        compliance, nodes = np.empty((0, 0)), np.empty(0, np.int64)
        for _ in range(STEPS):
            if near.sum() > len(nodes):
                nodes = np.flatnonzero(near)
                compliance = body.compliance(*map(self._components, (close, close[nodes])))
            if not len(nodes):
                break
            of = (values[nodes] for values in (at, gap, total, sizes))
            found = newton_step(compliance, tool, nodes, *of)
            if found is None:
                return None
            step, sizes[nodes] = found
            shift = (compliance @ step.ravel()).reshape(at.shape)
            total[nodes] += step
            at = at + shift
            gap = tool.gap(at) + self.back
            deepest = float(gap.min(initial=0.0, where=~near))
            if deepest < -DEEP * size:
                near |= gap <= deepest / 2
            elif np.abs(shift).max() < self.settled * size:
                break
        else:
            return None
        forces = np.zeros(x.shape)
        forces[close] = total
        return forces.ravel()

    def _components(self, nodes: Numbers) -> Numbers:
        """Components of some nodes, one node after the other."""
        d = self.at_rest.shape[1]
        return np.asarray((nodes[:, None] * d + np.arange(d)).ravel())


def newton_step(
    compliance: Array,
    tool: Tool,
    nodes: Numbers,
    x: Array,
    gap: Array,
    acting: Array,
    size: Array,
) -> tuple[Array, Array] | None:
    """Changes of the forces of some nodes, (m, d) in N, and their sizes after it, (m,).

    None if the problem has no solution.
    """
    m, d = x.shape
    n, every = tool.normal(x), np.arange(m)
    among = compliance.reshape(-1, d, m * d)[nodes]
    bend = size[:, None, None] * tool.curvature(x)
    system = np.eye(m * d) - (bend @ among).reshape(m * d, m * d)
    right = np.zeros((m, d, 1 + m))
    right[:, :, 0] = size[:, None] * n - acting
    right[every, :, 1 + every] = n
    try:
        change = np.linalg.solve(system, right.reshape(m * d, 1 + m))
    except np.linalg.LinAlgError:
        return None
    slopes = (n[:, None] @ among)[:, 0] @ change
    offset = gap + slopes[:, 0] - slopes[:, 1:] @ size
    found = solve_complementarity(slopes[:, 1:], offset, size > 0)
    if found is None or not np.isfinite(found).all():
        return None
    step = (change @ np.append(1.0, found - size)).reshape(m, d)
    return np.where(found[:, None] > 0, step, -acting), found
