r"""A random uniform traction on a patch of the boundary, as consistent nodal forces.

.. math:: f_a = \int_{Γ} N_a \, \bar t \, dS

is the force at node a, in N, with the shape functions N_a of the facets of the patch Γ
(Deshpande et al. 2022, Eq. VWP, second term). In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from datagen.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator
from shared_schema.cells import boundary_facets

GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)


class Traction(LoadFamily):
    """A uniform dead traction on the boundary facets whose nodes all lie in the region.

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each component of the traction, in Pa.
    """

    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a facet of the region."""
        lonely = np.flatnonzero(nodal_areas(loadable) == 0)
        if lonely.size:
            at = ",".join(f"{x:g}" for x in loadable.coordinates[loadable.nodes[lonely[0]]])
            raise ValueError(f"key 'region': the node at {at} belongs to no facet of the region")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the traction and convert it to nodal forces."""
        traction = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        return LoadCase(loadable.nodes, np.outer(nodal_areas(loadable), traction))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region."""
        return len(loadable)


def nodal_areas(loadable: LoadableNodes) -> NDArray[np.float64]:
    """Integrate N_a over the facets of the region, for each of its nodes: (n_loadable,) in m²."""
    facets = boundary_facets(loadable.cells, loadable.cell_type)
    facets = facets[np.isin(facets, loadable.nodes).all(axis=1)]
    areas = np.zeros(len(loadable.coordinates))
    np.add.at(areas, facets, facet_shares(loadable.coordinates[facets]))
    return areas[loadable.nodes]


def facet_shares(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integrate N_a over each facet, for each of its corners.

    The integrals are L/2 on edges of length L and A/3 on triangles of area A. On quadrilaterals
    they are computed with 2 × 2 Gauss points, which is exact for plane facets.

    Parameters
    ----------
    corners : array, (n_facets, n_corners, d)
        Corner positions in m: two corners are an edge in the plane; three or four are a triangle
        or quadrilateral in space, in order around it.

    Returns
    -------
    array, (n_facets, n_corners)
        In m²; edges are those of a body 1 m thick.
    """
    count = corners.shape[1]
    if count == 2:
        length = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
        return np.repeat(length[:, None] / 2, 2, axis=1)
    if count == 3:
        sides = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
        return np.repeat(area[:, None] / 3, 3, axis=1)
    shares = np.zeros(corners.shape[:2])
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for xi in GAUSS:
        for eta in GAUSS:
            shape = (1 + signs[:, 0] * xi) * (1 + signs[:, 1] * eta) / 4
            along_xi = np.einsum("a,fad->fd", signs[:, 0] * (1 + signs[:, 1] * eta) / 4, corners)
            along_eta = np.einsum("a,fad->fd", signs[:, 1] * (1 + signs[:, 0] * xi) / 4, corners)
            area = np.linalg.norm(np.cross(along_xi, along_eta), axis=1)
            shares += area[:, None] * shape
    return shares
