r"""Assembly on one rank: element tensors are added directly into vector and matrix.

The global vector and matrix are sums over the cells c of the element vectors and matrices,

.. math:: f_{int} = \sum_c A_c^T f_c, \qquad K = \sum_c A_c^T K_c A_c,

where A_c picks the degrees of freedom of cell c. The place in memory of every entry of every
element tensor is determined once; each assembly is then one loop over the cells in C
(`datagen.discretisation.element_loop`), without PETSc's search for the place of each matrix entry.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.sparsity import sparsity
from datagen.discretisation.unknowns import Unknowns
from datagen.solver.weak_form import WeakForm


class CellSums:
    """Loops over the cells of one rank that sum up tangent and internal forces.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    held, moved : array of int
        Entries of the state, ghosts included, whose rows of the tangent are not summed; nor are
        the columns of held ones.

    Attributes
    ----------
    pattern : Sparsity
        Of the tangent.
    """

    def __init__(
        self,
        forms: WeakForm,
        unknowns: Unknowns,
        held: NDArray[np.intp],
        moved: NDArray[np.intp],
    ) -> None:
        dofs = unknowns.cell_dofs
        block_size = unknowns.state.function_space.dofmap.index_map_bs
        size = len(unknowns.state.x.array)
        columns = np.zeros(size, dtype=bool)
        columns[held] = True
        rows = columns.copy()
        rows[moved] = True
        self.pattern = sparsity(dofs, size, block_size, rows, columns)
        owned = rows[: unknowns.owned]
        self._diagonal = self.pattern.diagonal[: unknowns.owned][owned]
        self._forces = forms.loop(forms.internal, unknowns, dofs, size)
        # The last value takes the dropped entries.
        count = len(self.pattern.indices) + 1
        self._tangent = forms.loop(forms.tangent, unknowns, self.pattern.places, count)
        self.tangent_values = self._tangent.values[:-1]

    def sum_forces(self) -> NDArray[np.float64]:
        """f_int of the cells of this rank, in N, in the layout of the state."""
        return self._forces.run()

    def sum_tangent(self) -> NDArray[np.float64]:
        """Values of the tangent of the cells of this rank in N/m, the identity in fixed rows."""
        self._tangent.run()
        self.tangent_values[self._diagonal] = 1.0
        return self.tangent_values


class SerialAssembly:
    """Tangent and internal forces of a problem whose mesh lives on one rank.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    held : array of int
        Held degrees of freedom: the tangent has the rows and columns of the identity there.
    moved : array of int
        Degrees of freedom with a prescribed displacement: the tangent has the rows of the identity
        there, and keeps their columns, so that a Newton step moves the rest of the body with them.

    Attributes
    ----------
    matrix : PETSc.Mat
        Sequential, in compressed rows; `assemble_tangent` changes its values in place.
    """

    def __init__(
        self,
        forms: WeakForm,
        unknowns: Unknowns,
        held: NDArray[np.intp],
        moved: NDArray[np.intp],
    ) -> None:
        size = unknowns.owned
        self._sums = CellSums(forms, unknowns, held, moved)
        pattern = self._sums.pattern
        self.matrix = PETSc.Mat().createAIJWithArrays(
            (size, size),
            (pattern.indptr, pattern.indices, self._sums.tangent_values),
            comm=PETSc.COMM_SELF,
        )
        self.matrix.setBlockSize(unknowns.state.function_space.dofmap.index_map_bs)

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current state, the identity in the fixed rows."""
        self._sums.sum_tangent()
        self.matrix.assemble()

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the internal forces at the current state, in N."""
        b.array_w[:] = self._sums.sum_forces()
