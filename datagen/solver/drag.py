"""Forces that hold a body back near a state, of a body on its way to an equilibrium."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc


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
