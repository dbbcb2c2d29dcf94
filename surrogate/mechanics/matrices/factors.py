r"""Factors of the stiffness of a body, and orders of its unknowns that leave little in them.

A band is factorised by Cholesky's method, in n b² operations. LAPACK's ``pbtrf`` does them at the
speed of dense matrices, on the bodies of the package more than twice as fast as SuperLU, and it
fails exactly where a matrix is not positive definite, that is where an equilibrium is not stable. A
matrix that is not symmetric is factorised by ``gbtrf``, Gauss's elimination with pivoting.

SuperLU, which is always there, factorises :math:`A = L D L^T` without row exchanges, with the
unknowns in an order of least degree, which limits the fill; the signs of D tell whether a matrix is
positive definite (Sylvester's law of inertia). Where ``pypardiso`` is installed
(``pip install solid-surrogate[large]``; x86), PARDISO factorises a matrix by Cholesky's method, on
a body of 20 000 nodes in a tenth of the time; it fails exactly where a matrix is not positive
definite. That of a body with pressures of its own it factorises as :math:`L D L^T`, with pivots.
"""

from __future__ import annotations

import logging
import threading
import weakref
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.linalg.lapack import dgbtrf, dgbtrs, dpbtrf
from scipy.sparse import coo_array, csc_array, csr_array, diags, triu
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
Values = NDArray[Any]  # in single or double precision
MANY, WIDE = 4, 16  # right-hand sides, and diagonals, from which on blocks are faster
BLOCK = 128  # columns of a block
IN_PLACE = {"diag_pivot_thresh": 0.0, "permc_spec": "NATURAL", "options": {"SymmetricMode": True}}
CLOSE = 1e-5  # relative error that a factor in single precision may have
NEGATIVE = 23  # what PARDISO says of a factor L D Lᵀ: its number of negative eigenvalues
ACCURATE = 1e-8  # residual of a solution, relative to the right-hand side


@dataclass(frozen=True)
class BandCholesky:
    """The factor L of A = L Lᵀ.

    Attributes
    ----------
    factor : array, (b + 1, n)
        LAPACK's lower band storage; its precision is that of all solutions.
    """

    factor: Values

    @property
    def width(self) -> int:
        """Number b of diagonals below the main one."""
        return len(self.factor) - 1

    @cached_property
    def single(self) -> BandCholesky:
        """The same factor in single precision; it is read, and so solves, in half the time."""
        return BandCholesky(np.asfortranarray(self.factor, np.float32))

    @cached_property
    def _blocks(self) -> list[tuple[Values, Values]]:
        """Blocks of L, from the first rows to the last: inverse of that on the diagonal, and below.

        With inverses all of a solve is products of one library: those of NumPy and SciPy, each with
        threads that wait for work, would take the cores from each other.
        """
        (trtri,) = get_lapack_funcs(("trtri",), (self.factor,))
        rows, n = self.factor.shape
        size, blocks = min(BLOCK, self.width), []
        for start in range(0, n, size):
            end, below = min(start + size, n), min(start + size + self.width, n)
            columns = self.factor[:, start:end]
            both = np.zeros((below - start, end - start), self.factor.dtype, order="F")
            for j in range(end - start):
                length = min(rows, below - start - j)
                both[j : j + length, j] = columns[:length, j]
            inverse = trtri(both[: end - start], lower=1)[0]
            filled = np.flatnonzero(both.any(axis=1))[-1] + 1  # the rows below are outside of A
            blocks.append((inverse, both[end - start : filled]))
        return blocks

    @classmethod
    def of(cls, band: Array) -> BandCholesky | None:
        """Factorise a band (n, b + 1), entry [j, i] that at (j + i, j), which is overwritten.

        None if the matrix is not positive definite.
        """
        factor, info = dpbtrf(band.T, lower=1, overwrite_ab=1)
        return cls(factor) if info == 0 else None

    def solve(self, right: Values) -> Values:
        """A⁻¹ b: (n,) or (n, m) → same; many right-hand sides are solved for block by block."""
        if right.ndim == 1 or right.shape[1] < MANY or len(self.factor) < WIDE:
            (pbtrs,) = get_lapack_funcs(("pbtrs",), (self.factor,))
            return pbtrs(self.factor, right, lower=1)[0]
        x, start = np.array(right, self.factor.dtype, order="C"), 0
        for inverse, below in self._blocks:  # L y = b
            end = start + len(inverse)
            x[start:end] = inverse @ x[start:end]
            x[end : end + len(below)] -= below @ x[start:end]
            start = end
        for inverse, below in reversed(self._blocks):  # Lᵀ x = y
            end, start = start, start - len(inverse)
            x[start:end] = inverse.T @ (x[start:end] - below.T @ x[end : end + len(below)])
        return x


@dataclass(frozen=True)
class BandLU:
    """The factors of A = P L U, of a band that need not be symmetric.

    Attributes
    ----------
    factors : array, (3 b + 1, n)
        LAPACK's general band storage.
    pivots : array of int, (n,)
    """

    factors: Array
    pivots: NDArray[np.int32]

    @classmethod
    def of(cls, band: Array) -> BandLU | None:
        """Factorise a band (n, 3 b + 1), entry [j, 2 b + i] that at (j + i, j); None if singular.

        The band is overwritten; its first b entries of each j are room for the factors.
        """
        width = (band.shape[1] - 1) // 3
        factors, pivots, info = dgbtrf(band.T, width, width, overwrite_ab=1)
        return cls(factors, pivots) if info == 0 else None

    def solve(self, right: Values) -> Values:
        """A⁻¹ b: (n,) or (n, m) → same."""
        width = (len(self.factors) - 1) // 3
        solution: Values = dgbtrs(self.factors, width, width, right, self.pivots)[0]
        return solution.reshape(right.shape)


class Solver(Protocol):
    """Factors of a matrix."""

    def solve(self, right: Array) -> Array:
        """Solve for right-hand sides, (n,) or (n, m) → same."""


class SparseFactor:
    """Factors of a sparse matrix, some of whose rows are displacements.

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


def super_lu(matrix: csc_array, negative: int) -> Solver | None:
    """Factors by SuperLU of a symmetric matrix, without exchanges of rows.

    None unless so many of its eigenvalues are negative.
    """
    try:
        lu: Any = splu(matrix, **IN_PLACE)
    except RuntimeError:  # exactly singular
        return None
    is_other = np.any(lu.perm_r != lu.perm_c) or (lu.U.diagonal() < 0).sum() != negative
    return None if is_other else lu


def general_lu(matrix: csc_array, places: NDArray[np.int64]) -> SparseFactor | None:
    """Factors by SuperLU of a matrix that is not symmetric; None if it is singular.

    Without exchanges of rows, as those of a symmetric one, which take less; with them where these
    are not accurate.

    Parameters
    ----------
    matrix : csc_array
    places : array of int, (n,)
        Rows of the displacements.
    """
    for options in (IN_PLACE, {}):
        try:
            factor = SparseFactor(splu(matrix, **options), matrix, places)
        except RuntimeError:  # singular
            continue
        if not options or factor.is_accurate():
            return factor
    return None


class Pardiso:
    """A factor by PARDISO, of the Math Kernel Library: L Lᵀ, or L D Lᵀ with pivots.

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
    def of(cls, matrix: csc_array, negative: int) -> Pardiso | None:
        """Factorise a symmetric matrix; None unless so many of its eigenvalues are negative."""
        import pypardiso

        upper = triu(matrix, format="csr")
        solver = pypardiso.PyPardisoSolver(mtype=-2 if negative else 2)
        try:
            solver.factorize(upper)
        except (pypardiso.pardiso_wrapper.PyPardisoError, ValueError):  # an empty row
            solver.free_memory(everything=True)
            return None
        made = cls(upper, solver)
        return made if negative in (0, solver.get_iparm(NEGATIVE)) else None

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


@cache
def tell_of_pardiso(unknowns: int) -> None:
    """Log, once for a body, what takes so long."""
    logger.info(
        "a stiffness of %d unknowns is factorised by SuperLU; with `pip install "
        '"solid-surrogate[large]"` (x86) that takes a tenth of the time or less',
        unknowns,
    )


SymmetricFactor: TypeAlias = BandCholesky | SparseFactor
Factor: TypeAlias = SymmetricFactor | BandLU


def in_single_precision(factor: SymmetricFactor, size: int) -> SymmetricFactor:
    """The factor in single precision, or itself if a random load tells the difference."""
    force = np.random.default_rng(0).normal(size=size)
    expected = factor.solve(force)
    difference = factor.single.solve(force.astype(np.float32)) - expected
    is_close = np.linalg.norm(difference) <= CLOSE * np.linalg.norm(expected)
    return factor.single if is_close else factor


def sum_of_cells(
    matrices: NDArray[np.float64], cells: NDArray[np.int64], unknowns: int
) -> csr_array:
    """Assemble the matrices of all cells.

    Parameters
    ----------
    matrices : array, (n_cells, m, m)
    cells : array of int, (n_cells, m)
        Unknowns of every cell.
    unknowns : int
        Number of rows and columns of the result.
    """
    size = cells.shape[1]
    rows, columns = np.repeat(cells, size, axis=1), np.tile(cells, size)
    shape = (unknowns, unknowns)
    return coo_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsr()


def band_order(
    coordinates: Array, cells: NDArray[np.int64], held: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], int]:
    """Order of the free degrees of freedom in which they form a narrow band, and its width.

    The free nodes are renumbered so that neighbours have near numbers: by the method of Cuthill and
    McKee (1969), reversed, or along the coordinate axis that gives a narrower band.

    Parameters
    ----------
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
    held : array of bool, (n_nodes, m)
        Components that are no degrees of freedom; m is d for displacements, 1 for scalars.

    Returns
    -------
    dofs : array of int, (n,)
        Free degrees of freedom, node · m + component.
    width : int
        Number b of diagonals below the main one.
    """
    d, corners = held.shape[1], cells.shape[1]
    free = np.flatnonzero(~held.all(axis=1))
    graph = sum_of_cells(np.ones((len(cells), corners, corners)), cells, len(coordinates))
    graph = graph[free][:, free].tocoo()

    def distance(order: NDArray[np.int64]) -> int:
        """Largest distance of neighbours."""
        place = np.argsort(order)
        return int(np.abs(place[graph.row] - place[graph.col]).max(initial=0))

    axes = np.arange(coordinates.shape[1])
    places = np.round(coordinates[free] / np.ptp(coordinates, axis=0).max(), 9)  # equal ones tie
    orders = [np.lexsort(places[:, np.roll(axes, shift)].T) for shift in axes]
    order = min([reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True), *orders], key=distance)
    dofs = (free[order][:, None] * d + np.arange(d)).ravel()
    return dofs[~held.ravel()[dofs]], distance(order) * d + d - 1


def dofs_of_least_degree(cells: NDArray[np.int64], held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Free degrees of freedom, node · m + component, in an order of least degree."""
    dofs = np.where(held, -1, np.arange(held.size).reshape(held.shape))
    found = dofs[of_least_degree(cells, len(held))].ravel()
    return found[found >= 0]


def of_least_degree(cells: NDArray[np.int64], points: int) -> NDArray[np.int64]:
    """Order of the points that leaves few entries in factors of their graph."""
    size = cells.shape[1]
    graph = sum_of_cells(np.ones((len(cells), size, size)), cells, points)
    graph = graph + csc_array(diags(np.full(points, float(graph.sum()))))  # definite
    lu = splu(csc_array(graph), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.asarray(np.argsort(lu.perm_c))
