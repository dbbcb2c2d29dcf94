r"""Contact of a linear body with a rigid tool: Newton's method around complementarity problems.

Around a state x with forces f of the tool, displacements are :math:`δx = C \, δf`
(`surrogate.touch.linear_body`). Sought is

.. math:: f_a = λ_a \, n(x_a), \qquad g(x_a) \ge 0, \quad λ_a \ge 0, \quad λ_a \, g(x_a) = 0,

with the distance g of the tool, its gradient n and Hessian H (`shared_schema.tools`). A step of
Newton's method is

.. math:: δf = (I - Λ H C)^{-1} (λ n - f + n \, δλ), \qquad
          0 \le λ + δλ \;⊥\; g + n^T C \, δf \ge 0,

a linear complementarity problem of the nodes near the tool.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.tools import Tool
from surrogate.touch.complementarity import solve_complementarity
from surrogate.touch.linear_body import LinearBody

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

STEPS = 25  # of Newton's method
SETTLED, DEEP, REACH = 1e-4, 1e-6, 0.1  # over the body's size: movement of the last step; depth
# of a node; distance of nodes that are looked at


def linear_contact(
    body: LinearBody,
    tool: Tool,
    x: Array,
    force: Array,
    back: float = 0.0,
    settled: float = SETTLED,
) -> Array | None:
    """Forces of a tool in N, (n, d), on a linear body; None if they are not found.

    Parameters
    ----------
    body : LinearBody
    tool : Tool
    x, force : array, (n, d)
        Positions of the surface in m, and the forces of a tool there that act in this state.
    back : float
        Length in m by which the surface of the tool is withdrawn.
    settled : float
        Movement of the last step over the size of the body; one more would be as its square.
    """
    size, gap = body.size, tool.gap(x) + back
    bears = np.asarray(force.any(axis=1))
    close = np.flatnonzero(bears | (gap < REACH * size))
    acts = bears[close]
    near = acts | (gap[close] < min(float(gap.min()) / 2, 0.0))
    total, at, gap, sizes = force[close], x[close], gap[close], np.zeros(len(close))
    sizes[acts] = np.maximum((total[acts] * tool.normal(at[acts])).sum(axis=1), 0.0)
    compliance, nodes = np.empty((0, 0)), np.empty(0, np.int64)
    for _ in range(STEPS):
        if near.sum() > len(nodes):
            nodes = np.flatnonzero(near)
            compliance = body.compliance(close, close[nodes])
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
        gap = tool.gap(at) + back
        deepest = float(gap.min(initial=0.0, where=~near))
        if deepest < -DEEP * size:
            near |= gap <= deepest / 2
        elif np.abs(shift).max() < settled * size:
            break
    else:
        return None
    forces = np.zeros(x.shape)
    forces[close] = total
    return forces


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
