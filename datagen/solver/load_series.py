r"""Start of Newton's method from rest: the path of equilibria as a power series of the load factor.

On the path that begins at the undeformed body,

.. math:: u(s) = s \, u_1 + s^2 u_2 + s^3 u_3 + \dots, \qquad R(u(s), s) = 0.

Each term follows from those before by one solve with the stiffness at rest (the asymptotic
numerical method, Cochelin 1994):

.. math::
    K_0 u_k = -c_k, \qquad
    R\Big(\sum_{j < k} s^j u_j, \; s\Big) = s^k c_k + O(s^{k+1}),

where :math:`c_1 = R(0, 1)`, and :math:`c_2, c_3` are differences of R at load factors ±ε that
stretch no cell by more than some thousandths. The solves are inexact: K₀ u_1 + c_1 = ρ is left,
which :math:`c_3` must not contain. Newton's method takes care of what the start lacks.

Where the load is stepped up, each of the first equilibria found adds a term in :math:`s^4`,
:math:`s^4 (s - s_1)`, so that the sum passes through it and those before.
"""

from __future__ import annotations

from itertools import accumulate
from typing import Protocol

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.unknowns import Unknowns

PASSED = 2  # equilibria that the sum may pass through; extrapolation through more is wild
SMALL = 2e-3  # largest difference of displacements in a cell under ε, over the size of the cells

Array = NDArray[np.float64]


class Equations(Protocol):
    """R of a body under its present load."""

    comm: MPI.Comm
    unknowns: Unknowns

    def residual_at(self, owned: Array, load_factor: float) -> Array:
        """R by the unknowns that this rank owns (collective); NaN where a cell is inverted."""


class LoadSeries:
    """Terms of the path of one body, load by load; every method is collective.

    Parameters
    ----------
    equations : Equations
    at_rest : petsc4py.PETSc.KSP
        Inexact solver of K₀ x = b, which this object keeps.
    cell_size : float
        In m.

    Attributes
    ----------
    at_rest : petsc4py.PETSc.KSP
    terms : list of array, (n_owned,)
        u_1, u_2 and u_3 under the last load, of the unknowns that this rank owns.
    """

    def __init__(self, equations: Equations, at_rest: PETSc.KSP, cell_size: float) -> None:
        self._equations, self.at_rest, self._cell_size = equations, at_rest, cell_size
        self._stiffness, _ = at_rest.getOperators()
        self._x, self._b = self._stiffness.createVecs()
        self._rest = np.zeros(self._x.local_size)
        self.terms: list[Array] = []
        self._passed: list[float] = []

    def expand(self) -> None:
        """Compute the terms under the present load; u_1 alone if it strains no cell."""
        residual = self._equations.residual_at
        first, left = self._response(residual(self._rest, 1.0))
        self.terms, self._passed = [first], []
        strain = self._largest_strain(first)
        if not 0.0 < strain < np.inf:
            return
        small = SMALL / strain
        ahead, back = (residual(s * first, s) for s in (small, -small))
        second, _ = self._response((ahead + back) / (2 * small**2))
        ahead, back = (residual(s * first + s**2 * second, s) for s in (small, -small))
        third, _ = self._response(((ahead - back) / (2 * small) - left) / small**2)
        self.terms += [second, third]

    def pass_through(self, load_factor: float) -> None:
        """Add a term with which the sum is the state of the problem, an equilibrium found."""
        if len(self._passed) > PASSED:
            return
        found = self._equations.unknowns.state.x.array[: len(self._rest)]
        rest = found - self._sums(load_factor)[-1]
        self._passed.append(load_factor)
        self.terms.append(rest / self._powers(load_factor)[-1])

    def begin(self, load_factor: float) -> None:
        """Set the state to the sum of the first terms that leaves the smallest residual.

        Once equilibria have been found, only sums that pass through the first of them count. The
        state stays as it is if cells are inverted in all of them, or after `PASSED` equilibria.
        """
        if len(self._passed) > PASSED:
            return
        before = self._equations.unknowns.state.x.array[: len(self._rest)].copy()
        sums = self._sums(load_factor)[-len(self._passed) :]  # all, before one is found
        residuals = [self._equations.residual_at(u, load_factor) for u in sums]
        squares = self._equations.comm.allreduce(np.array([r @ r for r in residuals]))
        sizes = np.where(np.isfinite(squares), squares, np.inf)
        best = sums[int(sizes.argmin())] if sizes.min() < np.inf else before
        self._equations.unknowns.set_owned(best)

    def _sums(self, s: float) -> list[Array]:
        products = (p * term for p, term in zip(self._powers(s), self.terms, strict=True))
        return list(accumulate(products))

    def _powers(self, s: float) -> list[float]:
        """s, s² and s³, then s⁴ (s − s_1) (s − s_2) … of the equilibria passed through before."""
        powers = [s**k for k in range(1, len(self.terms) - len(self._passed) + 1)]
        for number in range(len(self._passed)):
            powers.append(s**4 * float(np.prod([s - p for p in self._passed[:number]])))
        return powers

    def _response(self, coefficient: Array) -> tuple[Array, Array]:
        """Solve K₀ u = −c inexactly; return u and what is left, K₀ u + c."""
        self._b.array_w[:] = -coefficient
        self.at_rest.solve(self._b, self._x)
        response = self._x.array_r.copy()
        self._stiffness.mult(self._x, self._b)
        return response, self._b.array_r + coefficient

    def _largest_strain(self, displacement: Array) -> float:
        """Largest difference of displacements in a cell over the size of the cells."""
        unknowns = self._equations.unknowns
        unknowns.set_owned(displacement)
        count, d = unknowns.cell_points.shape[1], unknowns.point_dofs.shape[1]
        at_points = unknowns.state.x.array[unknowns.cell_dofs[:, : count * d]]
        differences = np.ptp(at_points.reshape(-1, count, d), axis=1)
        largest = self._equations.comm.allreduce(float(differences.max(initial=0.0)), MPI.MAX)
        return float(largest) / self._cell_size

    def close(self) -> None:
        """Release PETSc's memory."""
        for thing in (self.at_rest, self._x, self._b):
            thing.destroy()
