r"""Pressure that follows the deformed surface: its part in residual and tangent.

.. math:: f_a(u) = -p \int_{Γ(u)} N_a \, n \, dS

and its derivative with respect to u, which the tangent of the body lacks, are those of
`shared_schema.common.bodies.distributed_loads`. A facet of a quadratic element is deformed with all
its points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from shared_schema.common.bodies.distributed_loads import facet_derivatives, pressure_forces

Array = NDArray[np.float64]


class FollowerPressure:
    """Pressures on surfaces of a body that may be distributed over ranks.

    Every rank looks at all facets and keeps the rows of its own points.

    Parameters
    ----------
    coordinates : array, (n_points, d)
        Undeformed positions of the points of the elements in m, the same on every rank.
    surfaces : sequence of array of int, (n_facets, n_points of a facet)
        Facets of every surface by numbers of points, seen from outside.
    rows, columns : array of int, (n_points, d)
        Rows of the matrix, and its columns, of every point; -1 where they are not to be changed.

    Attributes
    ----------
    pressures : array, (n_surfaces,)
        Pressure on each surface in Pa.
    """

    def __init__(
        self,
        coordinates: Array,
        surfaces: Sequence[NDArray[np.int64]],
        rows: NDArray[np.int32],
        columns: NDArray[np.int32],
    ) -> None:
        self._coordinates, self._surfaces = coordinates, surfaces
        self.pressures = np.zeros(len(surfaces))
        self._rows, self._columns = rows, columns

    def forces(self, u: Array) -> Array:
        """Forces of the full pressures at a displacement in m: (n_points, d) in N."""
        total = np.zeros(u.shape)
        for facets, pressure in zip(self._surfaces, self.pressures, strict=True):
            if pressure:
                total += pressure_forces(self._coordinates + u, facets, pressure)
        return total

    def add_tangent(self, matrix: PETSc.Mat, u: Array, factor: float) -> None:
        """Add the derivative of −factor · `forces` to the matrix (collective)."""
        for facets, pressure in zip(self._surfaces, self.pressures, strict=True):
            if pressure:
                blocks = -factor * facet_derivatives(self._coordinates + u, facets, pressure)
                for points, block in zip(facets, blocks, strict=True):
                    rows, columns = self._rows[points].ravel(), self._columns[points].ravel()
                    matrix.setValues(rows, columns, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
