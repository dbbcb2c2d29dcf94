"""The same force on each node of the region in turn."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from shared_schema.common.keys.quantities import Magnitude
from shared_schema.loads.family import LoadableNodes, LoadCase, LoadFamily


class EachNode(LoadFamily):
    """One node per sample under a given force; the nodes take turns in the order of coordinates.

    With as many samples as nodes each node is loaded once, as in the paper's study of loads away
    from the training nodes (1.5 N on each node of the free edge).

    Attributes
    ----------
    force : tuple of d floats
        Force vector in N.
    """

    force: tuple[Magnitude, ...] = Field(min_length=2, max_length=3)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless the force has d components."""
        loadable.require_components("force", self.force)

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Load the next node: order by x, then y, then z, each from high to low."""
        size = np.ptp(loadable.coordinates, axis=0).max()
        places = (loadable.coordinates[loadable.nodes] / size).round(9)  # equal ones tie
        order = np.lexsort(-places.T[::-1])
        node = loadable.nodes[order[number % len(loadable)]]
        return LoadCase(np.array([node]), np.array([self.force]))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1
