r"""A random uniform body force, such as gravity in a random direction, as consistent nodal forces.

.. math:: f_a = \int_{Ω} N_a \, dV \; b

is the force at node a, in N, with the force density b in N per m³ of the undeformed body. What
would act on clamped nodes is borne by the supports. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from itertools import product
from math import factorial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from datagen.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator
from shared_schema.common.bodies.reference_cells import CORNERS, GAUSS


class BodyForce(LoadFamily):
    """A uniform force density on all cells whose nodes all lie in the region.

    Attributes
    ----------
    range : tuple of 2 floats
        (low, high) of each component of b, in N/m³; water has a weight of 9810 N/m³.
    """

    integrates: ClassVar[bool] = True

    range: ForceRange

    def check(self, loadable: LoadableNodes) -> None:
        """Raise ValueError unless every node of the region belongs to a cell of the region."""
        if not np.all(self._volumes(loadable) > 0):
            raise ValueError("key 'region': a node of it belongs to no cell of the region")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the force density and convert it to nodal forces."""
        density = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        return LoadCase(loadable.nodes, np.outer(self._volumes(loadable), density))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region that are not clamped."""
        return len(loadable)

    def _volumes(self, loadable: LoadableNodes) -> NDArray[np.float64]:
        members = loadable.nodes if loadable.region is None else loadable.region
        cells = loadable.cells[np.isin(loadable.cells, members).all(axis=1)]
        volumes = np.zeros(len(loadable.coordinates))
        np.add.at(volumes, cells, cell_shares(loadable.coordinates[cells]))
        return volumes[loadable.nodes]


def cell_shares(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integrate N_a over each cell, for each of its corners.

    Parameters
    ----------
    corners : array, (n_cells, n_corners, d)
        Corner positions in m, VTK order.

    Returns
    -------
    array, (n_cells, n_corners)
        In m³; cells in the plane are 1 m thick.
    """
    count, d = corners.shape[1:]
    if count == d + 1:
        volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / factorial(d)
        return np.repeat(volume[:, None] / count, count, axis=1)
    signs = 2 * np.array(CORNERS["quad" if d == 2 else "hexahedron"]) - 1
    shares = np.zeros(corners.shape[:2])
    for point in product(GAUSS, repeat=d):
        factors = (1 + signs * np.array(point)) / 2
        slopes = [signs[:, j] / 2 * np.delete(factors, j, axis=1).prod(axis=1) for j in range(d)]
        jacobians = np.einsum("cai,ja->cij", corners, np.array(slopes))
        shares += np.abs(np.linalg.det(jacobians))[:, None] * factors.prod(axis=1)
    return shares
