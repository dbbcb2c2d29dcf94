"""Forces of a rigid tool in a time step, which keep the surface of a body out of it.

In a step the body is nearly linear, with the compliance of :math:`K(0) + A` at rest
(`surrogate.mechanics.touch.loaded_body`); forces that let no node enter the tool are those of
`surrogate.mechanics.touch.tool_contact`. They are impulses over the step: their sum over time is
what the body gains in momentum.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, WorkError
from shared_schema.tools import Displaced, Tool
from surrogate.mechanics.touch.loaded_body import LinearBody
from surrogate.mechanics.touch.tool_contact import ToolContact

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
WRONG = 1e-4  # of the body's size: least depth or distance that matters
FAR, PLACES = 1e3, 9  # of the body's size: where gaps tell the way of a tool; places on it


@dataclass
class ToolForces:
    """Forces of a tool on a body.

    Attributes
    ----------
    contact : ToolContact
    linear : LinearBody
        The body in steps of this length, at the components of the surface.
    shape : tuple of int
        Of fields at all points.
    force : array, (m,)
        On these components in N.
    """

    contact: ToolContact
    linear: LinearBody
    shape: tuple[int, ...]
    force: Array
    at_points: Array = field(init=False)

    def __post_init__(self) -> None:
        self.at_points = self._spread(self.force)

    def answer(self, u: Array) -> Array | None:
        """Change the forces for a displacement (n_points, d) in m; the change in N, or None."""
        at, gap = u.ravel()[self.linear.components], self.contact.tool.gap
        if not self.force.any() and gap(self.contact.positions(at)).min() > 0:
            return None
        wanted = self.contact.forces(self.linear, at, self.force)
        if wanted is None:
            raise WorkError("the forces of the tool are not found: take shorter time steps")
        change = self._spread(wanted - self.force)
        self.force, self.at_points = wanted, self.at_points + change
        return change if change.any() else None

    def fits(self, u: Array, allowed: float) -> bool:
        """Whether a displacement is out of the tool, up to an error in m."""
        at = u.ravel()[self.linear.components]
        least = WRONG * float(np.ptp(self.contact.at_rest, axis=0).max())
        return self.contact.wrong(at, self.force) <= max(allowed, least)

    def _spread(self, force: Array) -> Array:
        found = np.zeros(self.shape)
        found.ravel()[self.linear.components] = force
        return found


def require_no_jump(x: Array, before: Tool, after: Tool) -> None:
    """Raise InputError where a tool jumps through nodes of the surface, (n, d) in m.

    Such a node is behind the tool in front of which it was, and inside it on a straight way between
    the two places.
    """
    size = float(np.ptp(x, axis=0).max())
    far = x.mean(axis=0) + FAR * size * np.eye(x.shape[1])
    way = before.gap(far) - after.gap(far)
    turned = x[(before.normal(x) * after.normal(x)).sum(axis=1) < 0]
    for share in np.linspace(0, 1, PLACES):
        between = Displaced(before, tuple(float(each) for each in share * way))
        if len(turned) and between.gap(turned).min() < -WRONG * size:
            raise InputError(
                "tool: it jumps through the body, expected shorter steps of it", "tool"
            )
