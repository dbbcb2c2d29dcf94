r"""Inertia of a tangent: the number of its negative eigenvalues, from a factorisation.

.. math:: P^T K P = L D L^T

has as many negative pivots D as K has negative eigenvalues (Sylvester's law of inertia). An
equilibrium is stable if K is positive definite. Where dilations θ and pressures p are unknowns
(`datagen.discretisation.element`), the potential is stationary but not least in them: the block of
θ and p alone has one negative eigenvalue for each p, whatever the state, so that as many negative
ones of K say that the energy is least in u (Haynsworth 1968, *Linear Algebra Appl.* 1, 73).

Pressures that follow the surface make K unsymmetric, and need not have a potential. If the
symmetric part of K is positive definite, the state is stable, since then all eigenvalues of K have
positive real parts (Bendixson 1902). If not, as many modes are unstable as :math:`K v = λ D v` has
λ with negative real parts: a body in a viscous fluid, :math:`D \dot u = -R(u)`, would leave the
state along them. They are the λ next to −c, where the symmetric part of :math:`K + c D` is positive
definite, and are found by Arnoldi's method. (A column under a pressure on its end, which turns
with it, has none, unlike one under a dead force: Beck 1952.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import csc_array, csr_array, diags, vstack
from scipy.sparse.linalg import LinearOperator, eigs, splu

from datagen.solver.drag import Drag
from datagen.solver.equilibrium import EquilibriumProblem

SEQUENTIAL_ROOT = 13  # ICNTL of MUMPS: ScaLAPACK does not count pivots
NEGATIVE_PIVOTS = 12  # INFOG of MUMPS
LEAST, GROWTH = 1e-8, 4.0  # first c, and its factor
MODES = 6  # eigenvalues that are looked at


class SymmetricFactor:
    """Factors L D Lᵀ of a problem's tangent, or of its symmetric part, without known displacements.

    Parameters
    ----------
    problem : EquilibriumProblem
        At the state and the load that the tangent is of.

    Attributes
    ----------
    excess : int
        Number of negative eigenvalues beyond those of pressures; the state is stable if it is 0.
    """

    def __init__(self, problem: EquilibriumProblem) -> None:
        tangent = problem.tangent()
        self._own = None
        if problem.load.presses or problem.supports.has_grip:
            self._own = tangent = _symmetric_part(problem, tangent)
        self._pc = PETSc.PC().create(tangent.comm)
        self._pc.setOperators(tangent)
        self._pc.setType("cholesky")
        self._pc.setFactorSolverType("mumps")
        self._pc.setFactorSetUpSolverType()
        factor = self._pc.getFactorMatrix()
        factor.setMumpsIcntl(SEQUENTIAL_ROOT, 1)
        self._pc.setUp()
        self.excess = factor.getMumpsInfog(NEGATIVE_PIVOTS) - pressures_of(problem)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Replace x by K⁻¹ b (collective)."""
        self._pc.apply(b, x)

    def close(self) -> None:
        """Release PETSc's memory."""
        self._pc.destroy()
        if self._own is not None:
            self._own.destroy()


def unstable_modes(problem: EquilibriumProblem, metric: PETSc.Vec | None = None) -> int:
    """Count the modes along which the present state is unstable (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
    metric : PETSc.Vec, optional
        D, as `metric_of` finds it, where it is known already.
    """
    factor = SymmetricFactor(problem)
    factor.close()
    if factor.excess == 0 or not problem.load.presses:
        return factor.excess
    own = metric_of(problem) if metric is None else metric
    shift, definite = shifted(problem, own)
    definite.close()
    found = _next_eigenvalues(problem, own, shift)
    if metric is None:
        own.destroy()
    return int((found.real < 0.0).sum())


def shifted(problem: EquilibriumProblem, metric: PETSc.Vec) -> tuple[float, SymmetricFactor]:
    """Find a c with which K + c D is positive definite: c, and the factors (collective)."""
    shift, drag = LEAST, problem.drag
    before, origin = (0.0, problem.state()) if drag is None else (drag.factor, drag.origin)
    while True:
        problem.drag = Drag(before + shift, metric, origin)
        found = SymmetricFactor(problem)
        problem.drag = drag
        if found.excess == 0:
            return shift, found
        found.close()
        shift *= GROWTH


def metric_of(problem: EquilibriumProblem) -> PETSc.Vec:
    """Diagonal D of the stiffness at rest, zero for known displacements and other unknowns."""
    state, factor, drag = problem.state(), problem.load_factor, problem.drag
    problem.reset()
    problem.load_factor, problem.drag = 0.0, None
    diagonal = problem.tangent().getDiagonal()
    problem.restore(state)
    problem.load_factor, problem.drag = factor, drag
    unknowns = problem.unknowns
    free = np.zeros(unknowns.owned, dtype=bool)
    free[unknowns.point_dofs[unknowns.point_dofs < unknowns.owned]] = True
    free[problem.supports.owned_fixed] = False
    diagonal.array_w[~free] = 0.0
    return diagonal


def _next_eigenvalues(
    problem: EquilibriumProblem, metric: PETSc.Vec, shift: float
) -> NDArray[np.complex128]:
    """Eigenvalues λ of K v = λ D v that are next to −c, of the whole matrix on every rank."""
    rows = problem.comm.allgather((problem.tangent().getValuesCSR(), metric.array_r.copy()))
    parts = [csr_array((a, j, i), (len(i) - 1, problem.size)) for (i, j, a), _ in rows]
    matrix, d = vstack(parts).tocsc(), diags(np.concatenate([d for _, d in rows]))
    inverse = splu(csc_array(matrix + shift * d))
    start = np.random.default_rng(0).standard_normal(problem.size)
    operator = LinearOperator(matrix.shape, lambda x: inverse.solve(d @ x), dtype=np.float64)
    found = eigs(operator, min(MODES, problem.size - 2), v0=start, return_eigenvectors=False)
    return np.asarray(1.0 / found - shift)


def pressures_of(problem: EquilibriumProblem) -> int:
    """Number of pressures among the unknowns; there are as many dilations."""
    displacements = problem.comm.allreduce(problem.points.size)
    return int(problem.size - displacements) // 2


def _symmetric_part(problem: EquilibriumProblem, tangent: PETSc.Mat) -> PETSc.Mat:
    """(K + Kᵀ) / 2 of the free unknowns, the identity in all other rows (collective)."""
    part = tangent.transpose(PETSc.Mat())
    part.axpy(1.0, tangent, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    part.scale(0.5)
    first, _ = tangent.getOwnershipRange()
    part.zeroRowsColumns((first + problem.supports.owned_moved).astype(PETSc.IntType), diag=1.0)
    return part
