r"""Sparse matrices of a body whose band would be too large, and their factors.

SuperLU, which is always there, factorises :math:`A = L D L^T` without row exchanges, with the
unknowns in an order of least degree, which limits the fill; the signs of D tell whether a matrix is
positive definite (Sylvester's law of inertia). Where ``pypardiso`` is installed
(``pip install surrogate[large]``; x86), PARDISO factorises a matrix by Cholesky's method, on a body
of 20 000 nodes in a tenth of the time; it fails exactly where a matrix is not positive definite.
"""

from __future__ import annotations

import logging
import threading
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags, triu
from scipy.sparse.linalg import splu
from torch import Tensor

from surrogate.mechanics.matrices.cell_matrices import sum_of_cells

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Facets = tuple[NDArray[np.int64], Array]  # of one surface, and their matrices
IN_PLACE = {"diag_pivot_thresh": 0.0, "permc_spec": "NATURAL", "options": {"SymmetricMode": True}}
ACCURATE = 1e-8  # residual of a solution, relative to the right-hand side


class Solver(Protocol):
    """Factors of a matrix."""

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides, (n,) or (n, m) → same."""


class SparseLayout:
    """Places of the unknowns of a body in its sparse tangents.

    Parameters
    ----------
    cells : array of int, (n_cells, m)
        Number of the unknown of each row of a cell's matrix.
    order : array of int, (n,)
        The unknowns that are not held, in the order of the rows.
    size : int
        Number of all unknowns.
    displacements : int
        Number of those of the displacement, point · d + component; they are the first.
    dimension : int
        d.
    negative : int
        Number of negative eigenvalues that a matrix has if its K is positive definite.
    eliminated : callable, optional
        Rows in the order in which SuperLU eliminates them, found when it does; by default as they
        are.

    Attributes
    ----------
    dofs : array of int
        Free degrees of freedom of the displacement, in the order of the rows.
    width : int
        About twice the mean number of entries of a row of a cell's matrix.
    """

    def __init__(
        self,
        cells: NDArray[np.int64],
        order: NDArray[np.int64],
        size: int,
        displacements: int,
        dimension: int,
        negative: int = 0,
        eliminated: Callable[[], NDArray[np.int64]] | None = None,
    ) -> None:
        self._cells, self._order, self._size = cells, order, size
        self._dimension, self._negative = dimension, negative
        self._eliminated = eliminated or partial(np.arange, len(order))
        self._places = np.flatnonzero(order < displacements)
        self.dofs = order[self._places]
        self.width = 2 * cells.shape[1]

    @classmethod
    def of(cls, cells: NDArray[np.int64], held: NDArray[np.bool_]) -> SparseLayout:
        """Layout of K alone, of cells (n_cells, n_corners) and held components (n_nodes, d)."""
        points, d = held.shape
        numbers = (cells[:, :, None] * d + np.arange(d)).reshape(len(cells), -1)
        order, eliminated = np.flatnonzero(~held), partial(rows_of_least_degree, cells, held)
        return cls(numbers, order, points * d, points * d, d, eliminated=eliminated)

    def assembled(self, cell_matrices: Tensor) -> list[csc_array]:
        """Add cell matrices (N, n_cells, m, m) into N matrices."""
        return [self._sum(each, self._cells) for each in cell_matrices.numpy()]

    def factor(self, matrix: csc_array) -> SparseFactor | None:
        """Factorise a matrix; None unless K is positive definite."""
        if self._negative == 0 and has_pardiso():
            cholesky = Pardiso.of(matrix)
            return None if cholesky is None else SparseFactor(cholesky, matrix, self._places)
        rows = self._elimination
        try:
            lu = splu(csc_array(matrix[rows][:, rows]), **IN_PLACE)
        except RuntimeError:  # exactly singular
            return None
        if np.any(lu.perm_r != lu.perm_c) or (lu.U.diagonal() < 0).sum() != self._negative:
            return None
        factor = SparseFactor(SuperLU(lu, rows), matrix, self._places)
        return factor if factor.is_accurate() else None

    @cached_property
    def _elimination(self) -> NDArray[np.int64]:
        """Rows in the order in which SuperLU eliminates them."""
        return self._eliminated()

    def diagonal(self, matrix: csc_array) -> Array:
        """Diagonal at `dofs`."""
        return np.asarray(matrix.diagonal())[self._places]

    def on_springs(self, matrix: csc_array, springs: Array) -> csc_array:
        """The matrix with more stiffness on the diagonal, (n,), at `dofs`."""
        diagonal = np.zeros(len(self._order))
        diagonal[self._places] = springs
        return csc_array(matrix + csc_array(diags(diagonal)))

    def with_facets(
        self, matrix: csc_array, facets: NDArray[np.int64], blocks: NDArray[np.float64]
    ) -> csc_array:
        """The matrix with the symmetric part of matrices of facets."""
        d = self._dimension
        if not len(facets):
            return matrix
        numbers = (facets[:, :, None] * d + np.arange(d)).reshape(len(facets), -1)
        return matrix + self._sum((blocks + blocks.transpose(0, 2, 1)) / 2, numbers)

    def under_pressure(
        self, matrix: csc_array, surfaces: Iterable[Facets]
    ) -> tuple[SparseFactor | None, bool]:
        """Factorise a matrix with those of facets; say whether its symmetric part is definite."""
        d = self._dimension
        symmetric, full = matrix, matrix
        for facets, blocks in surfaces:
            numbers = (facets[:, :, None] * d + np.arange(d)).reshape(len(facets), -1)
            full = full + self._sum(blocks, numbers)
            symmetric = self.with_facets(symmetric, facets, blocks)
        stable = self.factor(csc_array(symmetric)) is not None
        try:
            lu = splu(csc_array(full))
        except RuntimeError:
            return None, stable
        return SparseFactor(lu, csc_array(full), self._places), stable

    def _sum(self, matrices: Array, cells: NDArray[np.int64]) -> csc_array:
        total = sum_of_cells(matrices, cells, self._size)
        return csc_array(total[self._order][:, self._order])


class SparseFactor:
    """Factors of a matrix of a `SparseLayout`.

    Parameters
    ----------
    solver : Solver
    matrix : csc_array
    places : array of int, (n,)
        Rows of the displacements.
    refined : bool
        Refine every solution once.
    """

    def __init__(
        self,
        solver: Solver,
        matrix: csc_array,
        places: NDArray[np.int64],
        refined: bool = True,
    ) -> None:
        self._solver, self._matrix, self._places = solver, matrix, places
        self._refined = refined

    @property
    def title(self) -> str:
        """Name of the program that made the factors."""
        return "PARDISO" if isinstance(self._solver, Pardiso) else "SuperLU"

    @property
    def single(self) -> SparseFactor:
        """The same factors for forces in single precision, whose solutions are not refined."""
        return SparseFactor(self._solver, self._matrix, self._places, refined=False)

    def solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """K⁻¹ f, in the precision of f: (n,) or (n, m) → same."""
        found = self._whole(right.astype(np.float64, copy=False))[self._places]
        return found.astype(right.dtype, copy=False)

    def is_accurate(self) -> bool:
        """Whether the solution for random forces solves the equations."""
        force = np.random.default_rng(0).standard_normal(len(self._places))
        rest = -(self._matrix @ self._whole(force))
        rest[self._places] += force
        return bool(np.linalg.norm(rest) <= ACCURATE * np.linalg.norm(force))

    def _whole(self, right: Array) -> Array:
        """All unknowns."""
        whole = np.zeros((self._matrix.shape[0], *right.shape[1:]))
        whole[self._places] = right
        found = self._solver.solve(whole)
        if self._refined:
            found += self._solver.solve(whole - self._matrix @ found)
        return found


@dataclass(frozen=True)
class SuperLU:
    """Factors by SuperLU of a matrix with its rows in another order.

    Attributes
    ----------
    factors : scipy.sparse.linalg.SuperLU
    rows : array of int, (n,)
    """

    factors: Any
    rows: NDArray[np.int64]

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides, (n,) or (n, m) → same."""
        found = np.empty_like(right)
        found[self.rows] = self.factors.solve(right[self.rows])
        return found


class Pardiso:
    """A Cholesky factor by PARDISO, of the Math Kernel Library.

    Parameters
    ----------
    upper : csr_array
        Upper triangle of the matrix.
    solver : pypardiso.PyPardisoSolver
        Which holds the factor.
    """

    def __init__(self, upper: Any, solver: Any) -> None:
        self._upper, self._solver, self._lock = upper, solver, threading.Lock()
        weakref.finalize(self, solver.free_memory, everything=True)

    @classmethod
    def of(cls, matrix: csc_array) -> Pardiso | None:
        """Factorise a symmetric matrix; None unless it is positive definite."""
        import pypardiso

        upper, solver = triu(matrix, format="csr"), pypardiso.PyPardisoSolver(mtype=2)
        try:
            solver.factorize(upper)
        except (pypardiso.pardiso_wrapper.PyPardisoError, ValueError):  # an empty row
            solver.free_memory(everything=True)
            return None
        return cls(upper, solver)

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides, (n,) or (n, m) → same; one thread at a time."""
        with self._lock:
            return np.asarray(self._solver.solve(self._upper, right))


@cache
def has_pardiso() -> bool:
    """True if PARDISO is installed, with the Math Kernel Library that it is part of."""
    try:
        import pypardiso  # noqa: F401
    except ModuleNotFoundError:
        return False
    except ImportError as error:
        logger.warning("pypardiso: %s SuperLU, which takes more time, is used", error)
        return False
    return True


def rows_of_least_degree(cells: NDArray[np.int64], held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Order of least degree of the components that are not held, as numbers among these."""
    rows = np.where(held, -1, np.cumsum(~held).reshape(held.shape) - 1)
    found = rows[of_least_degree(cells, len(held))].ravel()
    return found[found >= 0]


def of_least_degree(cells: NDArray[np.int64], points: int) -> NDArray[np.int64]:
    """Order of the points that leaves few entries in factors of their graph."""
    size = cells.shape[1]
    graph = sum_of_cells(np.ones((len(cells), size, size)), cells, points)
    graph = graph + csc_array(diags(np.full(points, float(graph.sum()))))  # definite
    lu = splu(csc_array(graph), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(np.argsort(lu.perm_c))
