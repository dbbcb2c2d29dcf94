"""Assembly over several ranks.

Each rank sums up the element tensors of the cells that it owns, as on one rank
(`datagen.solver.serial_assembly`). Contributions to the rows of another rank's nodes are sent to
that rank and added there.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import COMPILER_OPTIONS, form
from datagen.solver.serial_assembly import CellSums
from datagen.solver.weak_form import WeakForm


class DistributedAssembly:
    """Tangent and internal forces of a problem whose mesh is distributed.

    Every method is collective over the ranks of the mesh.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    held : array of int
        Held degrees of freedom of this rank, ghosts included: the tangent has the rows and columns
        of the identity there.
    moved : array of int
        Those with a prescribed displacement, ghosts included: the tangent has the rows of the
        identity there, and keeps their columns.

    Attributes
    ----------
    matrix : PETSc.Mat
        Distributed by rows: each rank holds those of the entries of the state that it owns.
    """

    def __init__(
        self,
        forms: WeakForm,
        unknowns: Unknowns,
        held: NDArray[np.intp],
        moved: NDArray[np.intp],
    ) -> None:
        space = unknowns.state.function_space
        self._sums = CellSums(forms, unknowns, held, moved)
        indptr, indices = self._sums.pattern.indptr, self._sums.pattern.indices
        # One row after the other, with local numbers.
        self._rows = indptr, indices, np.arange(len(indptr) - 1, dtype=PETSc.IntType)
        product = ufl.inner(ufl.TrialFunction(space), ufl.TestFunction(space)) * ufl.dx
        self.matrix = fem_petsc.create_matrix(form(product, COMPILER_OPTIONS))

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current state, the identity in the fixed rows."""
        indptr, indices, rows = self._rows
        self.matrix.zeroEntries()
        self.matrix.setValuesLocalIJV(
            indptr,
            indices,
            self._sums.sum_tangent(),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=rows,
        )
        self.matrix.assemble()

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the internal forces at the current state, in N."""
        with b.localForm() as local:
            local.array_w[:] = self._sums.sum_forces()
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
