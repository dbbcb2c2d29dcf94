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
SETTLED, DEEP, REACH = 1e-4, 1e-6, 0.1  # over the body's size: movement of the last step, after
# which one more would be as its square; depth of a node; distance of nodes that are looked at


def linear_contact(
    body: LinearBody, tool: Tool, x: Array, force: Array, back: float = 0.0
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
    """
    size, gap = body.size, tool.gap(x) + back
    bears = np.asarray(force.any(axis=1))
    close = np.flatnonzero(bears | (gap < REACH * size))
    acts = bears[close]
    near = acts | (gap[close] < min(float(gap.min()) / 2, 0.0))
    total, at, sizes = force[close], x[close], np.zeros(len(close))
    sizes[acts] = np.maximum((total[acts] * tool.normal(at[acts])).sum(axis=1), 0.0)
    compliance, nodes = np.empty((0, 0)), np.empty(0, np.int64)
    for _ in range(STEPS):
        if near.sum() > len(nodes):
            nodes = np.flatnonzero(near)
            compliance = body.compliance(close, close[nodes])
        if not len(nodes):
            break
        found = newton_step(compliance, tool, nodes, at[nodes], total[nodes], sizes[nodes], back)
        if found is None:
            return None
        step, sizes[nodes] = found
        shift = (compliance @ step.ravel()).reshape(at.shape)
        total[nodes] += step
        at = at + shift
        gap = np.where(near, 0.0, tool.gap(at) + back)
        if gap.min() < -DEEP * size:
            near |= gap <= gap.min() / 2
        elif np.abs(shift).max() < SETTLED * size:
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
    acting: Array,
    size: Array,
    back: float,
) -> tuple[Array, Array] | None:
    """Changes of the forces of some nodes, (m, d) in N, and their sizes after it, (m,).

    None if the problem has no solution.
    """
    m, d = x.shape
    n, every = tool.normal(x), np.arange(m)
    among = compliance.reshape(-1, d, m * d)[nodes].reshape(m * d, m * d)
    bends, normals = np.zeros((m, d, m, d)), np.zeros((m, d, m))
    bends[every, :, every] = size[:, None, None] * tool.curvature(x)
    normals[every, :, every] = n
    bend, along = bends.reshape(m * d, m * d), normals.reshape(m * d, m)
    astray = (size[:, None] * n - acting).reshape(m * d, 1)
    system = np.eye(m * d) - bend @ among
    try:
        change = np.linalg.solve(system, np.hstack([astray, along]))
    except np.linalg.LinAlgError:
        return None
    slopes = along.T @ among @ change
    gap = tool.gap(x) + back + slopes[:, 0] - slopes[:, 1:] @ size
    found = solve_complementarity(slopes[:, 1:], gap, size > 0)
    if found is None or not np.isfinite(found).all():
        return None
    step = (change @ np.append(1.0, found - size)).reshape(m, d)
    return np.where(found[:, None] > 0, step, -acting), found
