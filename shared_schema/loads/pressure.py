"""A random pressure that follows the surface, as that of air in a chamber.

The pressure acts against the outward normal of the deformed surface, and its forces grow with its
area. A dataset holds as nodal forces those that the same pressure has on the undeformed body.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from shared_schema.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator
from shared_schema.loads.regions import Region


class Pressure(LoadFamily):
    """A uniform pressure on the boundary facets whose nodes all lie in the region.

    Of a group of facets or cells, these facets belong to it.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of the pressure in Pa; positive ones push into the body.
    """

    integrates: ClassVar[bool] = True
    of_sides: ClassVar[bool] = True
    presses: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        loadable.require_facets()

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the pressure."""
        pressure = float(generator(seed, number).uniform(*self.range))
        nothing = np.empty(0, dtype=np.int64), np.empty((0, loadable.dimension))
        return LoadCase(*nothing, pressure=pressure)

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of nodes under pressure that are not clamped."""
        return len(loadable)
