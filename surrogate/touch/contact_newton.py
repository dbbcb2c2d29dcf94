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
from surrogate.certify.correction import Correction, stable_state
from surrogate.mechanics.out_of_balance import Equilibrium
from surrogate.mechanics.tool_springs import ToolSprings
from surrogate.touch.body import LoadedBody
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
        self._surface = surface
        layout, stiffness = equilibrium.layout, np.zeros(equilibrium.free.size)
        at_rest = layout.assembled(equilibrium.solid.stiffness_at_rest())[0]
        stiffness[layout.dofs] = layout.diagonal(at_rest)
        of_nodes = stiffness.reshape(equilibrium.free.shape)[surface]
        self._stiffness = STIFFNESS * of_nodes.max(axis=1)
        self._at_rest = equilibrium.geometry.coordinates[surface]

    def find(
        self, tool: Tool, loaded: LoadedBody, field: Array, force: Array
    ) -> tuple[Correction, Array]:
        """Find the equilibrium and the forces.

        Parameters
        ----------
        tool : Tool
        loaded : LoadedBody
            The body under the load beside the tool.
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
        body = loaded.equilibrium
        f = body.forces_at_points(loaded.dead[None])
        u = body.at_points(field[None], f)
        if body.inverted(u)[0]:
            u, force = np.zeros_like(u), np.zeros_like(force)
        depth = max(0.0, -float(tool.gap(self._at_rest + u[0, self._surface]).min()))

        def go(share: float, last: tuple[Correction, Array]) -> tuple[Correction, Array]:
            at, sizes = last[0].displacement[None], last[1]
            given = self._surface, self._at_rest, self._stiffness, sizes, (1 - share) * depth
            found, after = self._balanced(body, ToolSprings(tool, *given), f, at)
            return replace(found, iterations=last[0].iterations + found.iterations), after

        found, sizes = halved_steps(
            go,
            (Correction(u[0], START, 0, 0.0), np.linalg.norm(force, axis=1)),
            lambda share: (
                f"no equilibrium with the tool is found: it enters the body by {share:.0%} of its "
                "depth"
            ),
        )
        at_nodes = found.displacement[: body.nodes]
        normal = tool.normal(self._at_rest + at_nodes[self._surface])
        return replace(found, displacement=at_nodes), sizes[:, None] * normal

    def reaction(
        self, tool: Tool, last: Tool, loaded: LoadedBody, field: Array, force: Array
    ) -> Array:
        r"""Resultant in N, (d,), of a tool close to the last one, linear around its equilibrium.

        With the stiffness K of body and springs, the normals N of the nodes that bear forces, the
        changes :math:`λ \, δn` of these forces by the tool's motion, and the distances g,

        .. math:: λ ← λ - (N^T K^{-1} N)^{-1} (g + N^T K^{-1} λ \, δn) + k \, g.

        Parameters
        ----------
        tool, last : Tool
        loaded : LoadedBody
            The body under the load beside the tool.
        field, force : array, (n_nodes, d) and (n, d)
            Displacement in m and forces on the surface in N in the last equilibrium.
        """
        u, sizes = loaded.at_points(field, loaded.dead), np.linalg.norm(force, axis=1)
        springs = ToolSprings(last, self._surface, self._at_rest, self._stiffness, sizes)
        bear, x = np.flatnonzero(sizes), self._at_rest + u[self._surface]
        respond = loaded.equilibrium.against(springs).response_at(u)
        if respond is None or not len(bear):
            return np.asarray(force.sum(axis=0))
        n, every, nodes = last.normal(x[bear]), np.arange(len(bear)), self._surface[bear]
        right = np.zeros((len(bear) + 1, *u.shape))
        right[every, nodes] = n
        right[-1, nodes] = sizes[bear, None] * (tool.normal(x[bear]) - n)
        moved = respond(right)[:, nodes]
        along, gap = np.einsum("abd,bd->ba", moved, n), tool.gap(x[bear])
        found = -np.linalg.solve(along[:, :-1], gap + along[:, -1])
        after = np.maximum(sizes[bear] + found + self._stiffness[bear] * gap, 0.0)
        shift = np.tensordot(np.append(found, 1.0), moved, 1)
        return np.asarray(after @ tool.normal(x[bear] + shift))

    def _balanced(
        self, body: Equilibrium, springs: ToolSprings, f: Array, u: Array
    ) -> tuple[Correction, Array]:
        """Equilibrium in which λ are the forces of the springs, and these, (n,)."""
        iterations, left, relative = 0, 0, FIRST
        for _ in range(ROUNDS):
            tolerance = ForceTolerance(relative=relative)
            found = stable_state(body.against(springs), f, u, START, tolerance)
            iterations, left = iterations + found.iterations, left + found.left
            u, sizes = found.displacement[None], springs.sizes(found.displacement)
            change = float(np.abs(sizes - springs.multipliers).max(initial=0.0))
            springs = replace(springs, multipliers=sizes)
            settled = change <= SETTLED * float(sizes.max(initial=0.0))
            if settled and relative == RELATIVE:
                return replace(found, iterations=iterations, left=left), sizes
            relative = max(TIGHTER * relative, RELATIVE)
        raise WorkError("the forces of the tool do not settle")
