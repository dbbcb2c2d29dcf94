"""What a tool does to a body: forces on its nodes, and how deep a node is inside of the tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.keys.units import Units

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contact:
    """What a tool does to a body.

    Attributes
    ----------
    force : array, (n_nodes, d)
        Forces of the tool on the nodes in N.
    penetration : float
        Largest depth of a node inside the tool in m.
    """

    force: Array
    penetration: float

    @property
    def reaction(self) -> Array:
        """Resultant of the tool's forces on the body in N, (d,)."""
        return np.asarray(self.force.sum(axis=0))

    @property
    def nodes(self) -> int:
        """Number of nodes that bear a force."""
        return int(self.force.any(axis=1).sum())


def contact_line(contact: Contact, units: Units) -> str:
    """Describe what a tool does."""
    total = ",".join(f"{value:.6g}" for value in contact.reaction)
    return (
        f"tool: force {total} {units.force} on {contact.nodes} nodes, penetration "
        f"{contact.penetration:.2g} {units.length}"
    )
