"""One force on each node of the region in turn."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from datagen.loads.family import LoadableNodes, LoadCase, LoadFamily


class EachNode(LoadFamily):
    """The same force on one node a sample, the nodes in the order of their coordinates.

    With as many samples as nodes, each is loaded once, as in the paper's study of loads away from
    the nodes of the training (1.5 N on each node of the free edge).

    Attributes
    ----------
    force : tuple of d floats
        In N.
    """

    force: tuple[float, ...] = Field(min_length=2, max_length=3)

    def check(self, loadable: LoadableNodes) -> None:
        """See that the force has as many components as the space."""
        loadable.require_components("force", self.force)

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Load the node whose turn it is: last axis fastest, highest coordinate first."""
        order = np.lexsort(-loadable.coordinates[loadable.nodes].T[::-1].round(9))
        node = loadable.nodes[order[number % len(loadable)]]
        return LoadCase(np.array([node]), np.array([self.force]))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """One."""
        return 1
