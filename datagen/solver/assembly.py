r"""Assembly of tangent and internal forces, on one rank and over several.

The global vector and matrix are sums over the cells c of the element vectors and matrices,

.. math:: f_{int} = \sum_c A_c^T f_c, \qquad K = \sum_c A_c^T K_c A_c,

where A_c picks the degrees of freedom of cell c. The place in memory of every entry of every
element tensor is determined once; each assembly is then one loop over the cells in C
(`datagen.discretisation.element_loop`), without PETSc's search for the place of each matrix entry.

Over several ranks, each sums up the element tensors of the cells that it owns. Contributions to the
rows of another rank's nodes are sent to that rank and added there.

The smallest J = det F over all Gauss points guards against inverted elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import basix
import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import ElementKind
from datagen.discretisation.element_loop import ElementLoop, FormLoop, Kernel
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import COMPILER_OPTIONS, form, point_expression
from datagen.solver.strain_energy import deformation_gradient
from datagen.solver.weak_form import WeakForm


@dataclass(frozen=True)
class Sparsity:
    """Compressed rows of a matrix that couples all degrees of freedom of every cell.

    Attributes
    ----------
    indptr, indices : array of int
        Row pointers and column indices, columns ascending in every row.
    places : array of int32, (n_cells, n_dofs²)
        Index of each entry of each element matrix among the values; one past the end if its row or
        column is dropped.
    diagonal : array of int, (n_rows,)
        Index of the diagonal entry of every row among the values.
    """

    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    places: NDArray[np.int32]
    diagonal: NDArray[np.intp]


def sparsity(
    dofs: NDArray[np.int32],
    size: int,
    block_size: int,
    dropped_rows: NDArray[np.bool_],
    dropped_columns: NDArray[np.bool_],
    coupled: Sequence[NDArray[np.integer[Any]]] = (),
) -> Sparsity:
    """Find the sparsity of a matrix.

    Parameters
    ----------
    dofs : array of int32, (n_cells, n_dofs)
        Degrees of freedom of every cell, in whole blocks.
    size : int
        Number of rows.
    block_size : int
        Number of consecutive degrees of freedom that every cell couples alike.
    dropped_rows, dropped_columns : array of bool, (size,)
        Degrees of freedom whose rows, or columns, are not assembled.
    coupled : sequence of array of int
        Degrees of freedom that are coupled as well, by cables from cell to cell.
    """
    blocks = dofs[:, ::block_size] // block_size
    rows, per_row = size // block_size, blocks.shape[1]
    keys = blocks[:, :, None].astype(np.int64) * rows + blocks[:, None, :]
    pairs = [np.add.outer(some * rows, some).ravel() for some in _blocks(coupled, block_size)]
    found = np.unique(np.concatenate([keys.ravel(), *pairs]))
    starts = np.searchsorted(found, np.arange(rows + 1, dtype=np.int64) * rows)
    columns = found % rows
    width = np.diff(starts)  # number of blocks in every row of blocks

    lengths = np.repeat(width * block_size, block_size)
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    inner = np.arange(block_size)
    in_rows = np.repeat(np.arange(rows), width)
    # The entry (i, j) of the k-th block of row r of blocks is at
    # b² starts[r] + i b width[r] + b (k - starts[r]) + j.
    first = block_size**2 * starts[in_rows] + block_size * (np.arange(len(found)) - starts[in_rows])
    stride = block_size * width[in_rows]
    indices = np.empty(indptr[-1], dtype=PETSc.IntType)
    for i in range(block_size):
        for j in range(block_size):
            indices[first + i * stride + j] = columns * block_size + j

    block = np.searchsorted(found, keys)
    at = (
        first[block][:, :, None, :, None]
        + stride[block][:, :, None, :, None] * (inner[:, None, None])
    )
    places = (at + inner).reshape(len(dofs), per_row * block_size, per_row * block_size)
    places[dropped_rows[dofs][:, :, None] | dropped_columns[dofs][:, None, :]] = len(indices)
    row_of = np.repeat(np.arange(size), lengths)
    return Sparsity(
        indptr.astype(PETSc.IntType),
        indices,
        np.ascontiguousarray(places.reshape(len(dofs), -1), dtype=np.int32),
        np.flatnonzero(row_of == indices),
    )


def _blocks(dofs: Sequence[NDArray[np.integer[Any]]], block_size: int) -> list[NDArray[np.int64]]:
    return [np.unique(some.astype(np.int64) // block_size) for some in dofs]


class MinimumJ:
    """Smallest J = det(I + ∇u) over the Gauss points of all cells.

    J is the ratio of deformed to undeformed volume. Where J ≤ 0 an element is inverted, and the
    strain energy, which holds ln J, is not defined.

    Parameters
    ----------
    unknowns : Unknowns
        Each rank evaluates the cells that it owns.
    kind : ElementKind
    """

    def __init__(self, unknowns: Unknowns, kind: ElementKind) -> None:
        state = unknowns.state
        domain = state.function_space.mesh
        cell = getattr(basix.CellType, domain.topology.cell_type.name)
        points, _ = basix.make_quadrature(cell, kind.quadrature_degree)
        u = ufl.split(state)[0] if kind.has_pressure else state
        self._comm = domain.comm
        self._expression: Any = point_expression(
            ufl.det(deformation_gradient(u)), points, COMPILER_OPTIONS
        )
        kernel = Kernel(self._expression.ufcx_expression.tabulate_tensor_float64, np.empty(0))
        count = len(unknowns.cell_dofs)
        places = np.arange(count * len(points), dtype=np.int32).reshape(count, -1)
        self._loop = ElementLoop(kernel, state, unknowns.cell_dofs, places, places.size)

    def value(self) -> float:
        """Smallest J at the current displacement, the same on every rank (collective)."""
        here = float(self._loop.run().min(initial=np.inf))
        return here if self._comm.size == 1 else float(self._comm.allreduce(here, op=MPI.MIN))


class Term(Protocol):
    """Forces that add to the assembly of a rank, with their derivative."""

    def add_forces(self) -> None:
        """Add the forces on the entries of the state of this rank to `Assembly.forces`."""

    def add_tangent(self) -> None:
        """Add their derivative to `Assembly.tangent`."""


@dataclass(frozen=True)
class Internal:
    """Internal forces of the cells of a rank."""

    forces: FormLoop
    tangent: FormLoop

    def add_forces(self) -> None:
        """Add f_int."""
        self.forces.add()

    def add_tangent(self) -> None:
        """Add ∂f_int/∂u."""
        self.tangent.add()

    def begin(self, before: NDArray[np.float64], first: int) -> None:
        """Give the first of two states in each cell, from a column on."""
        self.forces.give(before, first)
        self.tangent.give(before, first)


class Assembly:
    """Tangent and forces of a problem; every method is collective over its ranks.

    Parameters
    ----------
    forms : WeakForm
    unknowns : Unknowns
    held : array of int
        Held entries of the state, ghosts included: the tangent has the rows and columns of the
        identity there.
    moved : array of int
        Entries with a prescribed displacement, ghosts included: the tangent has the rows of the
        identity there, and keeps their columns, so that a Newton step moves the rest of the body
        with them.
    coupled : sequence of array of int
        Entries that the tangents of loads couple, on one rank.

    Attributes
    ----------
    matrix : PETSc.Mat
        Each rank holds the rows of the entries of the state that it owns. On one rank they are
        compressed rows, whose values `assemble_tangent` changes in place.
    internal_forces : Internal
    terms : list of Term
        What is assembled; internal forces at first.
    forces : array
        Sum of the cells of this rank, by entries of its state.
    tangent : array
        The same of the matrix, at `places`, with a last value for what is dropped.
    places : array of int32, (n_cells, n_entries²)
    """

    def __init__(
        self,
        forms: WeakForm,
        unknowns: Unknowns,
        held: NDArray[np.intp],
        moved: NDArray[np.intp],
        coupled: Sequence[NDArray[np.intp]] = (),
    ) -> None:
        space, dofs, size = (
            unknowns.state.function_space,
            unknowns.cell_dofs,
            len(unknowns.state.x.array),
        )
        block_size = space.dofmap.index_map_bs
        columns = np.zeros(size, dtype=bool)
        columns[held] = True
        rows = columns.copy()
        rows[moved] = True
        self._is_alone = space.mesh.comm.size == 1
        pairs = coupled if self._is_alone else ()
        pattern = sparsity(dofs, size, block_size, rows, columns, pairs)
        owned = rows[: unknowns.owned]
        self._diagonal = pattern.diagonal[: unknowns.owned][owned]
        self.places, self._unknowns = pattern.places, unknowns
        self.forces, self.tangent = np.zeros(size), np.zeros(len(pattern.indices) + 1)
        self.internal_forces = self.internal(forms)
        self.terms: list[Term] = [self.internal_forces]
        self._values = self.tangent[:-1]
        self._compressed = pattern.indptr, pattern.indices, self._values
        if self._is_alone:
            shape = size, size
            self.matrix = PETSc.Mat().createAIJWithArrays(
                shape, self._compressed, comm=PETSc.COMM_SELF
            )
            self.matrix.setBlockSize(block_size)
        else:
            product = ufl.inner(ufl.TrialFunction(space), ufl.TestFunction(space)) * ufl.dx
            self.matrix = fem_petsc.create_matrix(form(product, COMPILER_OPTIONS))
            if len(coupled):  # PETSc finds their places when they come first
                self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)

    def internal(self, forms: WeakForm) -> Internal:
        """Make the term of some forms."""
        known = self._unknowns, self._unknowns.cell_dofs
        return Internal(
            forms.loop(forms.internal, *known, len(self.forces), self.forces),
            forms.loop(
                forms.tangent, known[0], self.places, len(self.tangent), values=self.tangent
            ),
        )

    def assemble_tangent(self) -> None:
        """Assemble the matrix at the current state in N/m, the identity in the fixed rows."""
        self.tangent.fill(0.0)
        for term in self.terms:
            term.add_tangent()
        self._values[self._diagonal] = 1.0
        if not self._is_alone:
            self.matrix.zeroEntries()
            rows = np.arange(len(self._compressed[0]) - 1, dtype=PETSc.IntType)  # local numbers
            add = PETSc.InsertMode.ADD_VALUES
            self.matrix.setValuesLocalIJV(*self._compressed, addv=add, rowmap=rows)
        self.matrix.assemble()

    def assemble_forces(self, b: PETSc.Vec) -> None:
        """Replace `b` by the forces of all terms at the current state, in N."""
        self.forces.fill(0.0)
        for term in self.terms:
            term.add_forces()
        if self._is_alone:
            b.array_w[:] = self.forces
            return
        with b.localForm() as local:
            local.array_w[:] = self.forces
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
