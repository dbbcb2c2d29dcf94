r"""Pressure that follows the deformed surface: its nodal forces, and their derivative.

.. math::
    f_a(u) = -p \int_{Γ(u)} N_a \, n \, dS = -p \sum_q w_q N_a \; t_1 × t_2, \qquad
    t_k = \sum_b \frac{∂N_b}{∂ξ_k} (x_b + u_b),

with the tangents t of a facet (in the plane, n dS is its tangent turned by 90°). The derivative
with respect to the position of corner b, which the tangent of the body lacks, is

.. math::
    \frac{∂f_a}{∂u_b} e = -p \sum_q w_q N_a \left(
    \frac{∂N_b}{∂ξ_1} \, e × t_2 + \frac{∂N_b}{∂ξ_2} \, t_1 × e \right).

It is not symmetric (Bonet and Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*,
Section 8.5.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.mesh.node_numbering import NodeNumbering
from shared_schema.common.bodies.facet_quadrature import facet_tangents, normals_of, pressure_forces

Array = NDArray[np.float64]


class FollowerPressure:
    """Pressures on surfaces of a body that may be distributed over ranks.

    Every rank looks at all facets and keeps the rows of its own nodes.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        Undeformed positions in m, the same on every rank.
    surfaces : sequence of array of int, (n_facets, n_corners)
        Facets of every surface by node number, seen from outside.
    numbering : NodeNumbering
    rows_of_nodes : array of int, (n_nodes, d)
        Rows of the distributed matrix that belong to every node.
    fixed : array of bool, (n_nodes, d)
        Components without an equation, whose rows and columns stay as they are.
    moved : array of bool, (n_nodes, d)
        Those of them whose columns are kept.

    Attributes
    ----------
    pressures : array, (n_surfaces,)
        Pressure on each surface in Pa.
    """

    def __init__(
        self,
        coordinates: Array,
        surfaces: Sequence[NDArray[np.int64]],
        numbering: NodeNumbering,
        rows_of_nodes: NDArray[np.int64],
        fixed: NDArray[np.bool_],
        moved: NDArray[np.bool_],
    ) -> None:
        self._coordinates, self._surfaces, self._numbering = coordinates, surfaces, numbering
        self.pressures = np.zeros(len(surfaces))
        owned = np.zeros(len(coordinates), dtype=bool)
        owned[numbering.node_of_block[: numbering.owned]] = True
        self._rows = np.where(owned[:, None] & ~fixed, rows_of_nodes, -1).astype(PETSc.IntType)
        self._columns = np.where(fixed & ~moved, -1, rows_of_nodes).astype(PETSc.IntType)

    def forces(self, u: Array) -> Array:
        """Nodal forces of the full pressures at a displacement in m: (n_nodes, d) in N."""
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
                for corners, block in zip(facets, blocks, strict=True):
                    rows, columns = self._rows[corners].ravel(), self._columns[corners].ravel()
                    matrix.setValues(rows, columns, block, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()


def facet_derivatives(positions: Array, facets: NDArray[np.int64], pressure: float) -> Array:
    """Derivatives of the nodal forces of every facet: (n_facets, corners · d, corners · d) in N/m.

    Parameters
    ----------
    positions : array, (n_nodes, d)
        Positions of the nodes on the deformed body in m.
    facets : array of int, (n_facets, corners)
    pressure : float
        In Pa.
    """
    tangents, weighted, gradients = facet_tangents(positions[facets])
    count, points, _, d = tangents.shape
    change = np.zeros((count, points, facets.shape[1], d, d))  # of n dS, by corner and component
    for along in range(d - 1):
        for component in range(d):
            moved = tangents.copy()
            moved[:, :, along] = np.eye(d)[component]
            by_unit = normals_of(moved)  # linear in each tangent
            change[..., component] += gradients[None, :, :, along, None] * by_unit[:, :, None]
    blocks = -pressure * np.einsum("qa,fqbij->faibj", weighted, change)
    size = facets.shape[1] * d
    return blocks.reshape(count, size, size)
