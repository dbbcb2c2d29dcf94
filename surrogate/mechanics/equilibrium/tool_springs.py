r"""Springs between the surface of a body and a rigid tool, which push nodes out of it.

With forces λ in the undeformed springs of stiffness k, and the distance g of the tool, withdrawn
by a length (`shared_schema.tools`), their potential and forces are

.. math::
    Π_s = \sum_a \frac{1}{2 k_a} \left( \max(0, λ_a - k_a g_a)^2 - λ_a^2 \right), \qquad
    f_a = \max(0, λ_a - k_a g_a) \, n.

Where λ are the forces in equilibrium, nodes that bear them are on the surface of the tool: g = 0,
whatever k is (the method of multipliers; Powell 1969, Hestenes 1969).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.tools import Tool

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class ToolSprings:
    """Springs to one tool.

    Attributes
    ----------
    tool : Tool
    nodes : array of int, (n,)
    at_rest : array, (n, d)
        Undeformed positions of the nodes in m.
    stiffness, multipliers : array, (n,)
        k in N/m and λ in N.
    back : float
        Length in m by which the tool's surface is withdrawn.
    """

    tool: Tool
    nodes: Numbers
    at_rest: Array
    stiffness: Array
    multipliers: Array
    back: float = 0.0

    def sizes(self, u: Array) -> Array:
        """Sizes of the forces of one displacement, (n_nodes, d) in m → (n,) in N."""
        gap = self.tool.gap(self.at_rest + u[self.nodes]) + self.back
        return np.maximum(0.0, self.multipliers - self.stiffness * gap)

    def forces(self, u: Array) -> Array:
        """Forces on the nodes: (n_nodes, d) in m → same in N."""
        total = np.zeros(u.shape)
        normal = self.tool.normal(self.at_rest + u[self.nodes])
        total[self.nodes] = self.sizes(u)[:, None] * normal
        return total

    def potential(self, u: Array) -> float:
        """Π_s in J of one displacement, (n_nodes, d) in m."""
        changes = self.sizes(u) ** 2 - self.multipliers**2
        return float((changes / (2 * self.stiffness)).sum())

    def tangent(self, u: Array) -> tuple[Numbers, Array]:
        """Nodes that bear forces, (m, 1), and −∂f/∂u of each, (m, d, d) in N/m."""
        sizes = self.sizes(u)
        bear = np.flatnonzero(sizes)
        x = self.at_rest[bear] + u[self.nodes[bear]]
        n, k = self.tool.normal(x), self.stiffness[bear, None, None]
        blocks = k * n[:, :, None] * n[:, None, :]
        return self.nodes[bear, None], blocks - sizes[bear, None, None] * self.tool.curvature(x)
