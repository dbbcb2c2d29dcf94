"""One node of the region under a random force: the family of the paper's datasets."""

from __future__ import annotations

from shared_schema.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator


class RandomNode(LoadFamily):
    """One node per sample, each component of its force drawn from U(low, high).

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each force component, in N.
    balanced : bool
        If true, the nodes take turns, so that each is loaded equally often; otherwise the node is
        drawn uniformly.
    """

    range: ForceRange
    balanced: bool = True

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Choose the node, then draw its force."""
        random = generator(seed, number)
        count = len(loadable)
        chosen = number % count if self.balanced else int(random.integers(count))
        force = random.uniform(*self.range, size=(1, loadable.dimension))
        return LoadCase(loadable.nodes[[chosen]], force)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: one."""
        return 1
