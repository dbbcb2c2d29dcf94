r"""The first direction from a displacement towards the equilibrium, which estimates its error.

.. math:: d = -P(u) \, r(u)

with the out-of-balance forces r and the carried compliance P
(`surrogate.mechanics.descent.carried_compliance`). If d is longer than u itself, or than u + d, the
displacement tells nothing: its forces are out of balance by more than it moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surrogate.mechanics.descent.descent import FAR
from surrogate.mechanics.descent.driven_body import DrivenBody, longest

Array = NDArray[np.float64]


def first_direction(body: DrivenBody, force: Array, u: Array) -> Array | None:
    """Return d at the nodes in m, (n_nodes, d); zero where a long one is of rounding errors.

    Parameters
    ----------
    body : DrivenBody
    force, u : array, (n_nodes, d)
        A dead load in N, what acts between the nodes after the nodal forces, and displacements in m
        at the nodes.

    Returns
    -------
    array or None
        None if a cell is inverted or a number is not finite.
    """
    equilibrium = body.equilibrium
    if not np.isfinite(u).all():
        return None
    (f,), (at_points,) = equilibrium.posed(force[None], u[None])
    state = body.state(at_points, f)
    if state is None:
        return None
    found = -body.compliance.at(state.u)(state.r)[: equilibrium.nodes]
    is_long = longest(found) > FAR * longest(u)  # or as long as rounding errors of a small load
    if is_long and body.is_balanced(state, f):
        return np.zeros_like(u)
    return found


def exceeds_motion(error: Array, u: Array) -> bool:
    """Whether an estimated error is longer than u, or than the true displacement, u − error.

    Both are in m, (n_nodes, d); infinite errors are.
    """
    size = longest(error)
    return not np.isfinite(size) or size > min(longest(u), longest(u - error))
