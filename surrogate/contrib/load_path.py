r"""Load paths: how an equilibrium changes with its load, to second order.

.. math::
    u(f + t Δf) = u + t u_1 + t^2 u_2 + O(t^3), \qquad u_1 = K(u)^{-1} Δf, \qquad
    u_2 = -\tfrac{1}{2} K(u)^{-1} \big(K'(u)[u_1] \, u_1\big)

The second coefficient is a simplified Newton step: with a small h,
:math:`h^2 u_2 ≈ -K(u)^{-1} \big(r(u + h u_1, f + h Δf) - r(u, f)\big)`. One more such
step from the end of a path, t = 1, estimates the remainder there; a path ends where it counts. So K
paths through a solved sample take one factorisation, and 3 K solves with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.newton_steps import norms
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium

Array = NDArray[np.float64]
SMALL, TINY = 0.001, float(np.finfo(np.float64).tiny)  # h, and no division by zero
REMAINDER = 1e-4  # largest one, relative to ‖u‖
HALVINGS = 10  # of a path on which cells are inverted


@dataclass(frozen=True)
class LoadPaths:
    """K load paths through one equilibrium, for t in [-1, 1].

    Attributes
    ----------
    change : array, (K, n_nodes, d)
        Δf in N.
    first, second : array, (K, n_nodes, d)
        u₁ and u₂ in m.
    """

    change: Array
    first: Array
    second: Array

    def shortened(self, s: Array) -> LoadPaths:
        """Return the parts of the paths up to t = s, (K,), with s as their new end."""
        s = s[:, None, None]
        return LoadPaths(
            np.where(s > 0, s * self.change, 0.0),
            np.where(s > 0, s * self.first, 0.0),
            np.where(s > 0, s**2 * self.second, 0.0),
        )


def follow(equilibrium: Equilibrium, u: Array, f: Array, change: Array) -> LoadPaths:
    """Follow the equilibrium of a body along changes of its load.

    Paths are shortened so that their remainder is about 1e-4 ‖u‖ at most. They have no length
    where the equilibrium is not stable.

    Parameters
    ----------
    equilibrium : Equilibrium
    u : array, (n_nodes, d)
        Equilibrium in m.
    f : array, (n_nodes, d)
        Its forces in N.
    change : array, (K, n_nodes, d)
        Δf in N.
    """
    nothing = np.zeros(change.shape)
    respond = equilibrium.response_at(u)
    if respond is None:
        return LoadPaths(nothing, nothing, nothing)
    here = equilibrium.out_of_balance(u[None], f[None])

    def newton_steps(step: Array, change: Array) -> Array:
        return -respond(equilibrium.out_of_balance(u + step, f + change) - here)

    first = respond(change)
    paths = LoadPaths(change, first, newton_steps(SMALL * first, SMALL * change) / SMALL**2)
    paths = paths.shortened(_reach(equilibrium, u, paths))
    remainder = norms(newton_steps(paths.first + paths.second, paths.change))
    wanted = REMAINDER * np.linalg.norm(u)
    return paths.shortened(np.minimum(1, np.cbrt(wanted / np.maximum(remainder, TINY))))


def _reach(equilibrium: Equilibrium, u: Array, paths: LoadPaths) -> Array:
    """Largest t = 1, 1/2, 1/4, … of every path at which no cell is inverted; 0 if there is none."""
    t = np.ones(len(paths.change))
    for _ in range(HALVINGS):
        s = t[:, None, None]
        bad = equilibrium.inverted(u + s * paths.first + s**2 * paths.second) > 0
        if not bad.any():
            return t
        t[bad] /= 2
    t[bad] = 0
    return t


def neighbours(geometry: Geometry) -> list[NDArray[np.int64]]:
    """Other loadable nodes of the cells around every node, for each of the nodes."""
    found: list[set[int]] = [set() for _ in geometry.coordinates]
    for cell in geometry.cells.tolist():
        loadable = [node for node in cell if geometry.loadable[node]]
        for node in loadable:
            found[node].update(loadable)
    return [np.array(sorted(nodes - {node})) for node, nodes in enumerate(found)]


def random_changes(
    f: Array,
    beside: list[NDArray[np.int64]],
    size: float,
    count: int,
    generator: np.random.Generator,
) -> Array:
    r"""Draw changes of a load that keep its kind: (count, n_nodes, d) in N.

    .. math:: Δf = \sum_a e_a \, ε_a + m_a (e_b - e_a) f_a, \qquad
       ε_a \sim N(0, s^2 I), \quad m_a \sim U(-1, 1)

    over the loaded nodes a, each with a random neighbour b: the forces change, and move.

    Parameters
    ----------
    f : array, (n_nodes, d)
        Forces in N.
    beside : list of array of int
        Loadable neighbours of every node (`neighbours`).
    size : float
        s in N.
    count : int
    generator : numpy.random.Generator
    """
    change = np.zeros((count, *f.shape))
    for path in change:
        for a in np.flatnonzero(f.any(axis=1)):
            path[a] += generator.normal(0.0, size, f.shape[1])
            if len(beside[a]):
                moved = generator.uniform(-1, 1) * f[a]
                path[a] -= moved
                path[generator.choice(beside[a])] += moved
    return change
