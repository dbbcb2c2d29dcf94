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

from datagen.discretisation.element_loop import ElementLoop
from datagen.discretisation.sparsity import sparsity
from datagen.discretisation.unknowns import Unknowns
from datagen.solver.weak_form import WeakForm, kernel_of


class CellSums:
    """Loops over the cells of one rank that sum up tangent and internal forces.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    dropped : array of bool
        Entries of the state, ghosts included, whose rows and columns of the tangent are not summed.

    Attributes
    ----------
    pattern : Sparsity
        Of the tangent.
    """

    def __init__(self, forms: WeakForm, unknowns: Unknowns, dropped: NDArray[np.bool_]) -> None:
        state, dofs = unknowns.state, unknowns.cell_dofs
        block_size = state.function_space.dofmap.index_map_bs
        size = len(dropped)
        self.pattern = sparsity(dofs, size, block_size, dropped)
        self._forces = ElementLoop(
            kernel_of(forms.internal), state, dofs, dofs, size, forms.elimination
        )
        self._tangent = ElementLoop(
            kernel_of(forms.tangent),
            state,
            dofs,
            self.pattern.places,
            len(self.pattern.indices) + 1,  # the last value takes the dropped entries
            forms.elimination,
        )
        self.tangent_values = self._tangent.values[:-1]

    def sum_forces(self) -> NDArray[np.float64]:
        """f_int of the cells of this rank, in N, in the layout of the state."""
        return self._forces.run()

    def sum_tangent(self) -> NDArray[np.float64]:
        """Values of the tangent of the cells of this rank, in N/m."""
        self._tangent.run()
        return self.tangent_values


class SerialAssembly:
    """Tangent and internal forces of a problem whose mesh lives on one rank.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    held : array of int
        Held degrees of freedom: the tangent has the rows and columns of the identity there.

    Attributes
    ----------
    matrix : PETSc.Mat
        Sequential, in compressed rows; `assemble_tangent` changes its values in place.
    """

    def __init__(self, forms: WeakForm, unknowns: Unknowns, held: NDArray[np.intp]) -> None:
        size = unknowns.owned
        dropped = np.zeros(size, dtype=bool)
        dropped[held] = True
        self._sums = CellSums(forms, unknowns, dropped)
        pattern = self._sums.pattern
        self._diagonal = pattern.diagonal[dropped]
        self.matrix = PETSc.Mat().createAIJWithArrays(
            (size, size),
            (pattern.indptr, pattern.indices, self._sums.tangent_values),
            comm=PETSc.COMM_SELF,
        )
        self.matrix.setBlockSize(unknowns.state.function_space.dofmap.index_map_bs)

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current state, the identity in the held rows."""
        self._sums.sum_tangent()[self._diagonal] = 1.0
        self.matrix.assemble()

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the internal forces at the current state, in N."""
        b.array_w[:] = self._sums.sum_forces()
