r"""Inertia of a tangent: the number of its negative eigenvalues, from a factorisation.

.. math:: P^T K P = L D L^T

has as many negative pivots D as K has negative eigenvalues (Sylvester's law of inertia). An
equilibrium is stable if K is positive definite. Where dilations θ and pressures p are unknowns
(`datagen.discretisation.element`), the potential is stationary but not least in them: the block of
θ and p alone has one negative eigenvalue for each p, whatever the state, so that as many negative
ones of K say that the energy is least in u (Haynsworth 1968, *Linear Algebra Appl.* 1, 73).

Pressures that follow the surface make K unsymmetric. Its symmetric part is looked at: if that is
positive definite, no neighbouring state is in equilibrium, and the load does no work on any way
out. The unsymmetric part belongs to the edges of the surface under pressure; without edges, or
where they are held, there is none.
"""

from __future__ import annotations

from petsc4py import PETSc

from datagen.solver.equilibrium import EquilibriumProblem

SEQUENTIAL_ROOT = 13  # ICNTL of MUMPS: ScaLAPACK does not count pivots
NEGATIVE_PIVOTS = 12  # INFOG of MUMPS


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


def negative_eigenvalues(problem: EquilibriumProblem) -> int:
    """Count the negative eigenvalues of K at the present state, pressures aside (collective)."""
    factor = SymmetricFactor(problem)
    factor.close()
    return factor.excess


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
