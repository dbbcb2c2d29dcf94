r"""Supports and grips: degrees of freedom whose displacement is known.

.. math:: u = 0 \quad \text{where held}, \qquad u = s \bar u \quad \text{where moved}.

In these rows the residual is u, or :math:`u - s \bar u`, and the tangent is the identity. The
forces that the rows had before are those of the supports, and of the grip.

A drag holds a body back near a state, on its way to an equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.unknowns import Unknowns

Array = NDArray[np.float64]


class Supports:
    """Held and moved degrees of freedom of one rank.

    Parameters
    ----------
    unknowns : Unknowns
    held : array of bool, (n_nodes, d)
        Components whose displacement is zero, by node number.
    moved : array of bool, (n_nodes, d)
        Components whose displacement is prescribed by the loads.

    Attributes
    ----------
    fixed, moved : array of bool, (n_nodes, d)
        Components without an equation, and those of them that are moved.
    held_dofs, moved_dofs : array of int
        Entries of the state, ghosts included.
    owned_moved, owned_fixed : array of int
        Those of moved, and of all without an equation, that this rank owns.
    has_grip : bool
        True if a component is moved.
    """

    def __init__(
        self, unknowns: Unknowns, held: NDArray[np.bool_], moved: NDArray[np.bool_]
    ) -> None:
        self._unknowns, self.moved, self.fixed = unknowns, moved, held | moved
        self.has_grip = bool(moved.any())
        held_points = unknowns.held(held)
        self._moved_points = unknowns.held(self.fixed) & ~held_points
        self.held_dofs = unknowns.point_dofs[held_points].astype(np.intp)
        self.moved_dofs = unknowns.point_dofs[self._moved_points].astype(np.intp)
        self._owns_moved = self.moved_dofs < unknowns.owned
        self._held = self.held_dofs[self.held_dofs < unknowns.owned]
        self.owned_moved = self.moved_dofs[self._owns_moved]
        self.owned_fixed = np.concatenate([self._held, self.owned_moved])
        self._prescribed = np.zeros(len(self.owned_moved))

    def prescribe(self, displacement: Array | None) -> bool:
        """Set ū, (n_nodes, d) in m, 0 if None; returns whether a component of it is not 0."""
        self._prescribed[:] = 0.0
        if displacement is None:
            return False
        at_points = self._unknowns.at_points(displacement)[self._moved_points]
        self._prescribed[:] = at_points[self._owns_moved]
        return bool(displacement[self.moved].any())

    def hold(self) -> None:
        """Set the displacement of the held degrees of freedom to zero."""
        self._unknowns.state.x.array[self._held] = 0.0
        self._unknowns.state.x.scatter_forward()

    def replace_rows(self, b: PETSc.Vec, x: PETSc.Vec, load_factor: float) -> Array:
        """Set the residual of known displacements.

        Parameters
        ----------
        b : PETSc.Vec
            Forces out of balance in N; changed in place.
        x : PETSc.Vec
            Displacement in m.
        load_factor : float
            s.

        Returns
        -------
        array
            Forces of the grip on this rank in N.
        """
        b.array_w[self._held] = x.array_r[self._held]
        grip: Array = b.array_r[self.owned_moved]
        if self.has_grip:
            b.array_w[self.owned_moved] = (
                x.array_r[self.owned_moved] - load_factor * self._prescribed
            )
        return grip


@dataclass(frozen=True)
class Drag:
    """Forces c D (u − u₀), which hold a body back near a state u₀, on the rows of one rank.

    Attributes
    ----------
    factor : float
        c.
    metric : PETSc.Vec
        Diagonal of D in N/m, zero where displacements are known and of other unknowns.
    origin : array
        u₀ in m, without ghosts.
    """

    factor: float
    metric: PETSc.Vec
    origin: NDArray[np.float64]

    def add_forces(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Add the forces at a state x to the residual."""
        b.array_w[:] += self.factor * self.metric.array_r * (x.array_r - self.origin)

    def add_tangent(self, matrix: PETSc.Mat) -> None:
        """Add c D to the tangent (collective)."""
        diagonal = self.metric.copy()
        diagonal.scale(self.factor)
        matrix.setDiagonal(diagonal, addv=PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
        diagonal.destroy()
