r"""Weights of nodes under a smooth patch on a surface.

.. math:: w_a = \int_{Γ} N_a \, \Big(1 - \frac{|x - c|^2}{R^2}\Big)^2 \, dS
   \quad \text{over } |x - c| < R

with the centre c and the radius R. A traction of the largest value t has the nodal forces
:math:`w_a t`. The integral is by Gauss quadrature. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.facet_quadrature import facet_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurfacePatches:
    """Facets of a surface with their quadrature (`facet_points`).

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
    def of(cls, coordinates: Array, facets: NDArray[np.int64]) -> SurfacePatches:
        """Take facets of a mesh whose nodes are at (n_nodes, d) in m."""
        return cls(len(coordinates), facets, *facet_points(coordinates[facets]))

    def weights(self, centre: Array, radius: float) -> Array:
        """Integrate for every node: (n_nodes,) in m², all zero where no facet is in reach."""
        squares = ((self.positions - centre) ** 2).sum(axis=-1) / radius**2
        reached = (squares < 1).any(axis=1)
        profile = np.clip(1 - squares[reached], 0, None) ** 2
        weights = np.zeros(self.nodes)
        np.add.at(weights, self.facets[reached], (profile * self.areas[reached]) @ self.values)
        return weights
