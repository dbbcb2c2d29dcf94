r"""A random uniform traction on a patch of the boundary, as consistent forces.

.. math:: f_a = \int_{Γ} N_a \, \bar t \, dS

is the force on point a, in N, with the shape functions N_a of the facets of the patch Γ (Deshpande
et al. 2022, Eq. VWP, second term). In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.facet_quadrature import facet_shares
from shared_schema.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator
from shared_schema.loads.regions import Region


class Traction(LoadFamily):
    """A uniform dead traction on the boundary facets whose nodes all lie in the region.

    Of a group of facets or cells, these facets belong to it.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of each component of the traction, in Pa.
    """

    integrates: ClassVar[bool] = True
    of_sides: ClassVar[bool] = True

    region: Region = Region(boundary=True)
    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        loadable.require_facets()

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the traction and convert it to forces."""
        traction = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        return loadable.under(np.outer(point_areas(loadable), traction))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region that are not clamped."""
        return len(loadable)


def point_areas(loadable: LoadableNodes) -> NDArray[np.float64]:
    """Integrate N_a over the facets of the region, for every point: (n_points,) in m²."""
    x, facets = loadable.positions, loadable.all_points(loadable.facets)
    areas = np.zeros(len(x))
    np.add.at(areas, facets, facet_shares(x[facets]))
    return areas
