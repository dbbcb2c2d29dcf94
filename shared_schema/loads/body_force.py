r"""A random uniform body force, such as gravity in a random direction, as consistent forces.

.. math:: f_a = \int_{Ω} N_a \, dV \; b

is the force on point a, in N, with the force density b in N per m³ of the undeformed body. What
would act on clamped nodes is borne by the supports. In two dimensions the body is 1 m thick.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from shared_schema.common.bodies.cell_volumes import nodal_volumes
from shared_schema.loads.family import ForceRange, LoadableNodes, LoadCase, LoadFamily, generator


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
        lonely = np.setdiff1d(loadable.nodes, loadable.cells[loadable.cells_inside])
        if lonely.size:
            raise ValueError("key 'region': a node of it belongs to no cell of the region")

    def draw(self, number: int, seed: int, loadable: LoadableNodes) -> LoadCase:
        """Draw the force density and convert it to forces."""
        density = generator(seed, number).uniform(*self.range, size=loadable.dimension)
        points = loadable.points
        cells = (loadable.cells if points is None else points.cells)[loadable.cells_inside]
        return loadable.under(np.outer(nodal_volumes(loadable.positions, cells), density))

    def loads_per_sample(self, loadable: LoadableNodes) -> int:
        """Number of loaded nodes: all nodes of the region that are not clamped."""
        return len(loadable)
