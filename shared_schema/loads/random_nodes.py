"""Several nodes of the region at once, each under a random force."""

from __future__ import annotations

from shared_schema.loads.family import (
    CountRange,
    ForceRange,
    LoadableNodes,
    LoadCase,
    LoadFamily,
    generator,
)


class RandomNodes(LoadFamily):
    """Several different nodes per sample, each component of their forces drawn from U(low, high).

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each force component, in N.
    count : tuple of 2 ints
        Smallest and largest number of nodes of a sample; the number is drawn uniformly.
    """

    range: ForceRange
    count: CountRange = (2, 5)

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError if a sample can need more nodes than the region has."""
        if len(loadable) < self.count[1]:
            raise ValueError(f"key 'count' = {self.count}: the region has {len(loadable)} nodes")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the number of nodes, then the nodes, then their forces."""
        random = generator(seed, number)
        count = int(random.integers(self.count[0], self.count[1] + 1))
        chosen = random.choice(len(loadable), size=count, replace=False)
        forces = random.uniform(*self.range, size=(count, loadable.dimension))
        return LoadCase(loadable.nodes[chosen], forces)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of loaded nodes."""
        return self.count[1]
