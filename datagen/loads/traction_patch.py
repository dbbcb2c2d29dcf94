r"""A smooth patch of traction at a random place of the boundary, as consistent nodal forces.

.. math:: t(x) = \bar t \, \Big(1 - \frac{|x - c|^2}{R^2}\Big)^2 \text{ for } |x - c| < R,
   \text{ else } 0, \qquad f_a = \int_{Γ} N_a \, t \, dS

with the centre c at a random node of the region and Γ the boundary facets whose nodes all lie in
the region. The integral is by Gauss quadrature. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datagen.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator
from datagen.mesh.regions import Region
from datagen.quantities import Size
from shared_schema.common.bodies.cells import boundary_facets
from shared_schema.common.bodies.facet_quadrature import facet_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Facets of a region with their quadrature (`facet_points`).

    Attributes
    ----------
    nodes : int
        Number of nodes of the mesh.
    facets : array of int, (n_facets, n_corners)
    positions : array, (n_facets, n_points, d)
        In m.
    areas : array, (n_facets, n_points)
        In m².
    values : array, (n_points, n_corners)
    """

    nodes: int
    facets: NDArray[np.int64]
    positions: Array
    areas: Array
    values: Array

    @classmethod
    def of(cls, loadable: LoadableNodes) -> Surface:
        """Find the boundary facets whose nodes are all loadable."""
        facets = boundary_facets(loadable.cells, loadable.cell_type)
        facets = facets[np.isin(facets, loadable.nodes).all(axis=1)]
        quadrature = facet_points(loadable.coordinates[facets])
        return cls(len(loadable.coordinates), facets, *quadrature)

    def weights(self, centre: Array, radius: float) -> Array:
        """Integrate N_a (1 − r²/R²)² for every node: (n_nodes,) in m²."""
        squares = ((self.positions - centre) ** 2).sum(axis=-1) / radius**2
        profile = np.clip(1 - squares, 0, None) ** 2
        weights = np.zeros(self.nodes)
        np.add.at(weights, self.facets, (profile * self.areas) @ self.values)
        return weights


class TractionPatch(LoadFamily):
    """A dead traction that falls smoothly from its centre to zero at some radius.

    Attributes
    ----------
    region : Region
        The whole surface by default.
    range : tuple of 2 floats
        (low, high) of each component of the largest traction, in Pa.
    radius : float
        R in m.
    """

    region: Region = Region(boundary=True)
    range: ForceRange
    radius: Size

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless a patch about any node of the region bears a force."""
        surface = Surface.of(loadable)
        for centre in loadable.coordinates[loadable.nodes]:
            if not surface.weights(centre, self.radius).any():
                at = ",".join(f"{x:g}" for x in centre)
                raise ValueError(
                    f"key 'radius' = {self.radius:g}: a patch about the node at {at} reaches no "
                    "quadrature point of a facet of the region"
                )

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the centre and the traction, and convert the traction to nodal forces."""
        random = generator(seed, number)
        centre = loadable.coordinates[loadable.nodes[random.integers(len(loadable))]]
        traction = random.uniform(*self.range, size=loadable.dimension)
        weights = Surface.of(loadable).weights(centre, self.radius)
        nodes = np.flatnonzero(weights)
        return LoadCase(nodes, np.outer(weights[nodes], traction))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Largest number of nodes under a patch about any node of the region."""
        surface, centres = Surface.of(loadable), loadable.coordinates[loadable.nodes]
        return max(int(np.count_nonzero(surface.weights(c, self.radius))) for c in centres)
