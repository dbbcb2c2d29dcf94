"""Assembly over several ranks, by dolfinx and PETSc.

Each rank computes the element tensors of the cells that it owns. Contributions to the rows of
another rank's nodes are sent to that rank and added there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc


class DistributedAssembly:
    """Tangent and internal forces of a problem whose mesh is distributed.

    Every method is collective over the ranks of the mesh.

    Parameters
    ----------
    internal, tangent : dolfinx forms
        f_int(u) in N and K(u) = ∂f_int/∂u in N/m.
    supports : list of dolfinx Dirichlet conditions
        Clamped degrees of freedom: the tangent has the rows and columns of the identity there.
    moved : array of int
        Degrees of freedom of this rank with a prescribed displacement: the tangent has the rows of
        the identity there, and keeps their columns.

    Attributes
    ----------
    matrix : PETSc.Mat
        Distributed by rows: each rank holds those of the nodes that it owns.
    """

    def __init__(
        self,
        internal: Any,
        tangent: Any,
        supports: list[Any],
        moved: NDArray[np.intp] | None = None,
    ) -> None:
        self._internal, self._tangent, self._supports = internal, tangent, supports
        self._moved = moved
        self.matrix = fem_petsc.create_matrix(tangent)

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current displacement, the identity in the clamped rows."""
        self.matrix.zeroEntries()
        fem_petsc.assemble_matrix(self.matrix, self._tangent, bcs=self._supports)
        self.matrix.assemble()
        if self._moved is not None:
            self.matrix.zeroRowsLocal(self._moved.astype(PETSc.IntType), diag=1.0)

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the internal forces at the current displacement, in N."""
        with b.localForm() as local:
            local.set(0.0)
        fem_petsc.assemble_vector(b, self._internal)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
