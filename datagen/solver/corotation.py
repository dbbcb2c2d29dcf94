r"""A preconditioner that is built for the undeformed body and turns with it.

Under large deformations parts of a body turn by large angles, while their strains stay moderate.
The tangent is then nearly that of the undeformed body, turned at every point b by the rotation
there:

.. math::
    K(u) ≈ \mathcal R K_0 \mathcal R^T, \qquad \mathcal R = \operatorname{diag}(R_b), \qquad
    P = \mathcal R \, M_0 \, \mathcal R^T ≈ K(u)^{-1}.

:math:`M_0 ≈ K_0^{-1}` is the cheapest that converges: a multigrid cycle from coarse to fine, one
that goes down and up, or the factors of :math:`K_0` (nearly incompressible bodies, and elements
with pressures, which do not turn). It is built once. :math:`R_b` is the rotation in the polar
decomposition of the mean of the deformation gradients :math:`F` at the centres of the cells around
the point, by Newton's iteration :math:`R ← (R + R^{-T}) / 2` (Higham 1986).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import basix
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import coo_array, csr_array

from datagen.discretisation.element import ElementKind
from datagen.discretisation.unknowns import Unknowns
from datagen.dolfinx_versions import geometry_nodes
from datagen.solver.linear_solver import (
    CASCADE_OPTIONS,
    GAMG_OPTIONS,
    factors,
    multigrid,
    set_up_gmres,
)
from shared_schema.common.bodies import polar_decomposition

CYCLES = ((CASCADE_OPTIONS, 100), (GAMG_OPTIONS, 80))  # and Krylov iterations of a trial at rest
CONVERGED = 1e-6  # relative residual of a trial at rest
AT_REST = 1e-2  # of the terms of a load series
SMALLEST = 1e-3  # determinant of a mean F, below which a point is not turned

Array = NDArray[np.float64]


class Corotation:
    """Preconditioner P of a body's tangent, a context of PETSc's type ``python``.

    Parameters
    ----------
    undeformed : PETSc.Mat
        K₀ in N/m, with the identity in held rows, which this object keeps.
    symmetric : bool
        K₀ is symmetric, which prescribed displacements prevent.
    unknowns : Unknowns
        Their state is followed.
    kind : ElementKind
    coordinates : array, (n_nodes, d)
        In m.

    Attributes
    ----------
    undeformed : PETSc.Mat
    at_rest : PETSc.PC
        M₀.
    uses_multigrid : bool
        True if M₀ is a multigrid cycle.
    """

    def __init__(
        self,
        undeformed: PETSc.Mat,
        symmetric: bool,
        unknowns: Unknowns,
        kind: ElementKind,
        coordinates: Array,
    ) -> None:
        self.undeformed = undeformed
        self.uses_multigrid = self._is_cascade = False
        points = unknowns.owned_points(coordinates)
        for options, most in () if kind.has_pressure else CYCLES:
            self.at_rest = multigrid(undeformed, points, options)
            self.uses_multigrid = _converges(undeformed, self.at_rest, most)
            if self.uses_multigrid:
                self._is_cascade = options is CASCADE_OPTIONS
                break
            self.at_rest.destroy()
        if not self.uses_multigrid:
            self.at_rest = factors(undeformed, symmetric and not kind.has_pressure)
        self._turned = undeformed.createVecRight()
        d = coordinates.shape[1]
        owned = unknowns.point_dofs[:, 0] < unknowns.owned
        self._dofs = unknowns.point_dofs[owned]
        self._state = unknowns.state.x.array
        self._slopes = _centre_gradients(unknowns)
        self._corners = unknowns.cell_dofs[:, : self._slopes.shape[1] * d]
        self._mean = _mean_around(unknowns.cell_points, len(self._dofs))
        self._rotations = np.broadcast_to(np.eye(d), (len(self._dofs), d, d))

    def solver_at_rest(self) -> PETSc.KSP:
        """Make a solver of K₀ x = b, to `AT_REST` of b."""
        return _krylov(self.undeformed, self.at_rest, AT_REST, CYCLES[0][1])

    def turn(self) -> None:
        """Follow the body to its present state."""
        _, corners, d = self._slopes.shape
        u = self._state[self._corners].reshape(-1, corners, d)
        f = np.einsum("cai,caj->cij", u, self._slopes) + np.eye(d)
        self._rotations = rotations((self._mean @ f.reshape(-1, d * d)).reshape(-1, d, d))

    def apply(self, pc: PETSc.PC | None, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Y = P x, called by PETSc."""
        values = x.array_r.copy()
        values[self._dofs] = np.einsum("nji,nj->ni", self._rotations, values[self._dofs])
        self._turned.array_w[:] = values
        self.at_rest.apply(self._turned, y)
        values = y.array_w
        values[self._dofs] = np.einsum("nij,nj->ni", self._rotations, values[self._dofs])

    @contextmanager
    def symmetric(self) -> Iterator[Callable[[PETSc.Vec, PETSc.Vec], None]]:
        """Make P symmetric for a while, by cycles of multigrid that go down and up; yield it."""
        kind = PETSc.PC.MGType
        if self._is_cascade:
            self.at_rest.setMGType(kind.MULTIPLICATIVE)
        try:
            yield lambda x, y: self.apply(None, x, y)
        finally:
            if self._is_cascade:
                self.at_rest.setMGType(kind.KASKADE)

    def destroy(self, pc: PETSc.PC) -> None:
        """Release PETSc's memory; PETSc calls this as it releases the solver."""
        for thing in (self.at_rest, self._turned, self.undeformed):
            thing.destroy()


def rotations(f: Array) -> Array:
    """Rotations R of the polar decompositions F = R U: (n, d, d) → (n, d, d).

    They are the identity where det F is not safely positive.
    """
    safe = np.where((np.linalg.det(f) > SMALLEST)[:, None, None], f, np.eye(f.shape[1]))
    turned = polar_decomposition.rotations(safe.transpose(1, 2, 0))
    return np.asarray(turned.transpose(2, 0, 1), np.float64)


def _krylov(matrix: PETSc.Mat, inner: PETSc.PC, tolerance: float, most: int) -> PETSc.KSP:
    ksp = PETSc.KSP().create(matrix.comm)
    set_up_gmres(ksp)
    ksp.setTolerances(rtol=tolerance, max_it=most)
    ksp.setOperators(matrix)
    ksp.setPC(inner)
    return ksp


def _converges(matrix: PETSc.Mat, inner: PETSc.PC, most: int) -> bool:
    """True if so many Krylov iterations take 6 digits off a residual (collective).

    The right-hand side is the same in every entry.
    """
    ksp = _krylov(matrix, inner, CONVERGED, most)
    x, b = matrix.createVecs()
    b.set(1.0)
    ksp.solve(b, x)
    converged = ksp.getConvergedReason() > 0
    for thing in (ksp, x, b):
        thing.destroy()
    return bool(converged)


def _mean_around(points: NDArray[np.intp], owned: int) -> csr_array:
    """Operator from values of the cells to their means around each owned point.

    Parameters
    ----------
    points : array of int, (n_cells, n_points)
        Points of this rank's cells, owned ones first.
    owned : int
        Number of points that this rank owns.
    """
    cells = np.repeat(np.arange(len(points)), points.shape[1])
    count = max(owned, int(points.max(initial=-1)) + 1)
    total = coo_array((np.ones(points.size), (points.ravel(), cells)), (count, len(points)))
    total = total.tocsr()[:owned]
    total.data /= np.repeat(np.diff(total.indptr), np.diff(total.indptr))
    return total


def _centre_gradients(unknowns: Unknowns) -> Array:
    """∇N_a of the corners at the centres of the cells: (n_cells, n_corners, d) in 1/m."""
    domain = unknowns.state.function_space.mesh
    cell = getattr(basix.CellType, domain.topology.cell_type.name)
    element = basix.create_element(basix.ElementFamily.P, cell, 1, basix.LagrangeVariant.gll_warped)
    d = domain.geometry.dim
    centre = basix.geometry(cell).mean(axis=0)[None, :]
    slopes = element.tabulate(1, centre)[1:].reshape(d, -1).T  # (n_corners, d)
    nodes = geometry_nodes(domain)[: len(unknowns.cell_dofs)]
    jacobians = np.einsum("cai,aj->cij", domain.geometry.x[nodes][:, :, :d], slopes)
    return np.asarray(np.einsum("aj,cji->cai", slopes, np.linalg.inv(jacobians)))
