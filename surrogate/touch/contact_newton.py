r"""Equilibrium of a body and a rigid tool together, by Newton's method: no prediction is made.

The contact is that of the factory (`datagen.solver.contact.tool_contact`). Its forces are found by
the method of multipliers (`surrogate.mechanics.tool_springs`): with springs to the tool, the
potential energy has a minimum, which Newton's method with a line search finds, past unstable
equilibria (`surrogate.certify.correction`); the forces there are the next λ.

So the contact holds bodies which its forces alone would not: beyond the load under which a column
buckles, there is no stable displacement to predict from the forces, and this finds it. From a state
that is known the tool's surface enters the body in steps, which are halved where they fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.force_tolerance import RELATIVE, ForceTolerance
from shared_schema.common.errors import WorkError
from shared_schema.tools import Tool
from surrogate.certify.correction import Correction, iterated
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.tool_springs import ToolSprings
from surrogate.touch.halved_steps import halved_steps

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
STIFFNESS = 100.0  # k over the largest stiffness of a node at rest
ROUNDS, SETTLED = 30, 1e-8  # of λ; its last change over the largest
FIRST, TIGHTER = 1e-6, 1e-2  # residual over the forces in the first round, and how it gets less
START = "contact with the tool"


class ContactNewton:
    """A body that tools touch.

    Parameters
    ----------
    equilibrium : Equilibrium
    surface : array of int, (n,)
        Nodes of the surface that can move.
    """

    def __init__(self, equilibrium: Equilibrium, surface: Numbers) -> None:
        self._body, self._surface = equilibrium, surface
        layout, stiffness = equilibrium.layout, np.zeros(equilibrium.free.size)
        at_rest = layout.assembled(equilibrium.solid.stiffness_at_rest())[0]
        stiffness[layout.dofs] = layout.diagonal(at_rest)
        of_nodes = stiffness.reshape(equilibrium.free.shape)[surface]
        self._stiffness = STIFFNESS * of_nodes.max(axis=1)
        self._at_rest = equilibrium.geometry.coordinates[surface]

    def find(self, tool: Tool, load: Array, field: Array, force: Array) -> tuple[Correction, Array]:
        """Find the equilibrium and the forces.

        Parameters
        ----------
        tool : Tool
        load : array, (n_nodes or n_points, d)
            Load in N beside the forces of the tool.
        field, force : array, (n_nodes, d) and (n, d)
            Displacement in m to begin from, and forces of a tool on the surface in N.

        Returns
        -------
        correction : Correction
        force : array, (n, d)
            Forces of the tool on the surface in N.

        Raises
        ------
        WorkError
            If no stable equilibrium is found.
        """
        body = self._body
        f = body.forces_at_points(load[None])
        u = body.at_points(field[None], f)
        if body.inverted(u)[0]:
            u, force = np.zeros_like(u), np.zeros_like(force)
        depth = max(0.0, -float(tool.gap(self._at_rest + u[0, self._surface]).min()))
        sizes = np.linalg.norm(force, axis=1)
        springs = ToolSprings(tool, self._surface, self._at_rest, self._stiffness, sizes)
        found = list[Correction]()

        def go(share: float) -> None:
            nonlocal springs
            at = found[-1].displacement[None] if found else u
            balanced, sizes = self._balanced(replace(springs, back=(1 - share) * depth), f, at)
            found.append(balanced)
            springs = replace(springs, multipliers=sizes)

        halved_steps(
            go,
            lambda share: (
                f"no equilibrium with the tool is found: it enters the body by {share:.0%} of its "
                "depth"
            ),
        )
        at_nodes = found[-1].displacement[: body.nodes]
        iterations = sum(each.iterations for each in found)
        normal = tool.normal(self._at_rest + at_nodes[self._surface])
        last = replace(found[-1], displacement=at_nodes, iterations=iterations)
        return last, springs.multipliers[:, None] * normal

    def reaction(self, tool: Tool, last: Tool, load: Array, field: Array, force: Array) -> Array:
        r"""Resultant in N, (d,), of a tool close to the last one, linear around its equilibrium.

        With the stiffness K of body and springs, the normals N of the nodes that bear forces, the
        changes :math:`λ \, δn` of these forces by the tool's motion, and the distances g,

        .. math:: λ ← λ - (N^T K^{-1} N)^{-1} (g + N^T K^{-1} λ \, δn) + k \, g.

        Parameters
        ----------
        tool, last : Tool
        load : array, (n_nodes or n_points, d)
            Load in N beside the forces of the tool.
        field, force : array, (n_nodes, d) and (n, d)
            Displacement in m and forces on the surface in N in the last equilibrium.
        """
        u, sizes = self._at_points(field, load), np.linalg.norm(force, axis=1)
        springs = ToolSprings(last, self._surface, self._at_rest, self._stiffness, sizes)
        bear, x = np.flatnonzero(sizes), self._at_rest + u[0, self._surface]
        respond = self._body.against(springs).response_at(u[0])
        if respond is None or not len(bear):
            return np.asarray(force.sum(axis=0))
        n, every, nodes = last.normal(x[bear]), np.arange(len(bear)), self._surface[bear]
        right = np.zeros((len(bear) + 1, *u.shape[1:]))
        right[every, nodes] = n
        right[-1, nodes] = sizes[bear, None] * (tool.normal(x[bear]) - n)
        moved = respond(right)[:, nodes]
        along, gap = np.einsum("abd,bd->ba", moved, n), tool.gap(x[bear])
        found = -np.linalg.solve(along[:, :-1], gap + along[:, -1])
        after = np.maximum(sizes[bear] + found + self._stiffness[bear] * gap, 0.0)
        shift = np.tensordot(np.append(found, 1.0), moved, 1)
        return np.asarray(after @ tool.normal(x[bear] + shift))

    def holds(self, load: Array, field: Array) -> bool:
        """True if the body is stable under the forces of the tool, without it."""
        return self._body.response_at(self._at_points(field, load)[0]) is not None

    def _at_points(self, field: Array, load: Array) -> Array:
        """Displacement of all points in m, (1, n_points, d), by that of the nodes under a load."""
        return self._body.at_points(field[None], self._body.forces_at_points(load[None]))

    def _balanced(self, springs: ToolSprings, f: Array, u: Array) -> tuple[Correction, Array]:
        """Equilibrium in which λ are the forces of the springs, and these, (n,)."""
        iterations, left, relative = 0, 0, FIRST
        for _ in range(ROUNDS):
            tolerance = ForceTolerance(relative=relative)
            found = iterated(self._body.against(springs), f, u, START, tolerance)
            iterations, left = iterations + found.iterations, left + found.left
            u, sizes = found.displacement[None], springs.sizes(found.displacement)
            change = float(np.abs(sizes - springs.multipliers).max(initial=0.0))
            springs = replace(springs, multipliers=sizes)
            settled = change <= SETTLED * float(sizes.max(initial=0.0))
            if settled and relative == RELATIVE:
                return replace(found, iterations=iterations, left=left), sizes
            relative = max(TIGHTER * relative, RELATIVE)
        raise WorkError("the forces of the tool do not settle")
