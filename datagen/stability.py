r"""Stability of equilibria: kept if they are stable, else left, refused or recorded as they are.

The inertia of a tangent is the number of its negative eigenvalues, from a factorisation.

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

The tangent K of the last Newton step is looked at, if that step was small, by what is there.

- *Pivots* of its factors, where rows were not exchanged (LU in the plane): K is positive definite
  if they are positive.
- *Conjugate gradients*, with the preconditioner of the Krylov iterations, on :math:`K x = b` with
  random b. They meet a direction p of negative curvature, :math:`p^T K p < 0`, or converge. As long
  as curvatures are positive, the residual polynomial q has positive roots only and q(0) = 1, so
  that |q| > 1 at negative eigenvalues: the part of b along a direction that loses energy never
  decreases. The residual of a K that is not positive definite thus stays above that part. In the
  norm of the preconditioner, in which the residual must fall to a hundredth, soft directions have
  large parts.
- *Factors* L D Lᵀ else.

From an unstable equilibrium to a stable one the body moves as in a viscous fluid. The unstable
state :math:`u^*` is disturbed along its lowest mode, and moves on by

.. math:: D \dot u = -R(u)

until it comes to rest: pseudo-transient continuation (Kelley and Keyes 1998, *SIAM J. Numer.
Anal.* 35, 508). The energy falls all the way, so that it ends in a stable equilibrium. An implicit
step from :math:`u_k` over the time 1/c solves

.. math:: R(u) + c \, D (u - u_k) = 0

by Newton's method. Like a load step, it is cut back where that fails, by a larger c, and also where
its tangent :math:`K + c D` is not positive definite, because then the energy need not have fallen.
After easy steps c decreases; where K itself is positive definite, Newton's method is tried without
it. D is the diagonal of the stiffness at rest.

The lowest mode is the v of least :math:`v^T K v` among all with :math:`v^T D v = 1`, found by
inverse iteration from the *imperfection*, a random vector at every node, which a seed determines.
Its part along v decides in which direction the state is left, and so which of two mirror images is
found. It is the same whatever the number of ranks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import csc_array, csr_array, diags, vstack
from scipy.sparse.linalg import LinearOperator, eigs, splu

from datagen.solver.bordered_newton import UnknownAmplitudes
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings
from datagen.solver.supports import Drag
from shared_schema.common.bodies.equilibrium import imperfection, mean_edge
from shared_schema.samples.results import SolveReport

SEQUENTIAL_ROOT = 13  # ICNTL of MUMPS: ScaLAPACK does not count pivots
NEGATIVE_PIVOTS = 12  # INFOG of MUMPS
LEAST, GROWTH = 1e-8, 4.0  # first c, and its factor
MODES = 6  # eigenvalues that are looked at
REDUCTION = 1e-2  # of the residual, in the norm of the preconditioner
ITERATIONS = 60
INVERSE_ITERATIONS = 30
AMPLITUDE = 0.1  # of the disturbance over the size of a cell
STEPS = 400
FEW = 5  # Newton iterations of an easy step
HALVINGS = 20
ROUNDING = 1e-12  # of energies, relative
UNSTABLE = "unstable equilibrium"
NOT_LEFT = "unstable equilibrium, and no stable one found from it"


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
        if problem.load.is_bordered:
            self.excess += _of_amplitudes(problem, self)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Replace x by K⁻¹ b (collective)."""
        self._pc.apply(b, x)

    def close(self) -> None:
        """Release PETSc's memory."""
        self._pc.destroy()
        if self._own is not None:
            self._own.destroy()


def _of_amplitudes(problem: EquilibriumProblem, factor: SymmetricFactor) -> int:
    r"""Count what unknown amplitudes add to the negative eigenvalues of K.

    Volumes and lengths that are given hold a body which is unstable under as large pressures and
    tensions, and so do gases. With :math:`h_a \, δa ± h_q \, G^T δu = 0` the bordered matrix
    :math:`((K, G), (G^T, -C))`, :math:`C = ± h_a / h_q`, has those of K and those of its Schur
    complement :math:`-C - G^T K^{-1} G` (E. V. Haynsworth 1968, *Linear Algebra Appl.* 1, 73). In a
    stable equilibrium they are as many as the amplitudes.
    """
    border, u = UnknownAmplitudes(problem), problem.displacement_of_points()
    unit = border.forces(u)
    _, by_amplitude, by_quantity = border.equations(u, np.ones(len(unit)))
    held = by_quantity != 0.0  # slack cables are not
    columns = []
    for forces in (g for g, each in zip(unit, held, strict=True) if each):
        g, w = problem.residual.duplicate(), problem.residual.duplicate()
        g.set(0.0)
        problem.load.add_to(g, forces)
        g.array_w[problem.supports.owned_fixed] = 0.0
        factor.solve(g, w)
        columns.append((g, w))
    response = np.array([[g.dot(w) for _, w in columns] for g, _ in columns])
    for vector in (each for pair in columns for each in pair):
        vector.destroy()
    if not len(columns):
        return 0
    schur = -np.diag(by_amplitude[held] / by_quantity[held]) - (response + response.T) / 2
    return int((np.linalg.eigvalsh(schur) < 0.0).sum()) - len(columns)


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
    if factor.excess == 0 or problem.load.is_bordered or not problem.load.presses:
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


def is_stable(problem: EquilibriumProblem) -> bool:
    """True if the equilibrium that Newton's method has just found is stable (collective)."""
    tangent = None if problem.kind.has_pressure else problem.tangent_of_last_step()
    if tangent is not None and problem.newton.used_lu and not problem.load.presses:
        pivots = problem.newton.pivots()
        if pivots is not None:
            return bool((pivots > 0.0).all())
    elif tangent is not None and not problem.newton.used_lu:
        found = _by_conjugate_gradients(problem, tangent)
        if found is not None:
            return found
    return unstable_modes(problem) == 0


def _by_conjugate_gradients(problem: EquilibriumProblem, tangent: PETSc.Mat) -> bool | None:
    """True if K is positive definite; None if the iteration does not tell (collective)."""
    residual = tangent.createVecRight()
    generator = np.random.default_rng([tangent.comm.rank])
    residual.array_w[:] = generator.standard_normal(residual.local_size)
    residual.array_w[problem.supports.owned_fixed] = 0.0
    product, step = residual.duplicate(), residual.duplicate()
    direction, transposed = residual.duplicate(), residual.duplicate()
    found, square, first = None, 1.0, 0.0
    with problem.newton.symmetric_preconditioner() as preconditioner:
        for iteration in range(ITERATIONS):
            preconditioner(residual, step)
            step.array_w[problem.supports.owned_fixed] = 0.0
            before, square = square, residual.dot(step)
            if not square > 0.0:  # the preconditioner is not positive definite
                break
            first = first or square
            if square <= REDUCTION**2 * first:
                found = True
                break
            direction.aypx(square / before if iteration else 0.0, step)
            tangent.mult(direction, product)
            if problem.load.presses:  # the symmetric part
                tangent.multTranspose(direction, transposed)
                product.axpby(0.5, 0.5, transposed)
            product.array_w[problem.supports.owned_fixed] = 0.0
            curvature = direction.dot(product)
            if not curvature > 0.0:
                found = False
                break
            residual.axpy(-square / curvature, product)
    for vector in (residual, product, step, direction, transposed):
        vector.destroy()
    return found


@dataclass(frozen=True)
class Relaxation:
    """Outcome of leaving an unstable equilibrium.

    Attributes
    ----------
    stable : bool
        True if `problem` holds a stable equilibrium.
    iterations : int
        Newton iterations of all steps.
    residual_norm : float
        2-norm of the residual of the last Newton solve, in N.
    """

    stable: bool
    iterations: int
    residual_norm: float


def relaxed(problem: EquilibriumProblem, seed: int) -> Relaxation:
    """Leave the unstable equilibrium that `problem` holds under its full load (collective).

    Parameters
    ----------
    problem : EquilibriumProblem
        Holds the new equilibrium afterwards, or the unstable one again.
    seed : int
        Of the imperfection.
    """
    unstable = problem.state()
    metric = metric_of(problem)
    try:
        found = _moved_on(problem, metric, seed)
    finally:
        problem.drag = None
        metric.destroy()
    if not found.stable:
        problem.restore(unstable)
    return found


def _moved_on(problem: EquilibriumProblem, metric: PETSc.Vec, seed: int) -> Relaxation:
    factor = _disturb(problem, metric, seed)
    iterations = 0
    for _ in range(STEPS):
        here = problem.state()
        problem.drag = Drag(factor, metric, here[: problem.unknowns.owned].copy())
        step = problem.solve(1.0, direct=True)
        iterations += step.iterations
        convex = step.converged and unstable_modes(problem, metric) == 0
        problem.drag = None
        if not convex:
            problem.restore(here)
            factor *= GROWTH
            continue
        if step.iterations <= FEW:
            factor /= GROWTH
        if unstable_modes(problem, metric) > 0:
            continue
        here, energy = problem.state(), _potential(problem)
        last = problem.solve(1.0, direct=True)
        iterations += last.iterations
        falls = last.converged and _potential(problem) <= energy + ROUNDING * abs(energy)
        if falls and unstable_modes(problem, metric) == 0:
            return Relaxation(True, iterations, last.residual_norm)
        problem.restore(here)
    return Relaxation(False, iterations, step.residual_norm)


def _disturb(problem: EquilibriumProblem, metric: PETSc.Vec, seed: int) -> float:
    """Move the state along its lowest mode; return a first c, with which K + c D is definite."""
    factor, held = shifted(problem, metric)
    mode, weighted = problem.residual.duplicate(), problem.residual.duplicate()
    mode.array_w[:] = _imperfection(problem, seed)
    for _ in range(INVERSE_ITERATIONS):
        weighted.pointwiseMult(metric, mode)
        weighted.scale(1.0 / weighted.norm())
        held.solve(weighted, mode)
    held.close()
    change = np.where(metric.array_r > 0.0, mode.array_r, 0.0)
    for vector in (mode, weighted):
        vector.destroy()
    largest = problem.comm.allreduce(np.abs(change).max(initial=0.0), op=MPI.MAX)
    change *= AMPLITUDE * mean_edge(problem.mesh.coordinates, problem.mesh.cells) / largest
    start = problem.state()
    for _ in range(HALVINGS):
        problem.move_by(change)
        if not problem.is_inverted:
            break
        problem.restore(start)
        change /= 2
    return GROWTH * factor


def _imperfection(problem: EquilibriumProblem, seed: int) -> NDArray[np.float64]:
    """Random vector of the unknowns that this rank owns, drawn node by node."""
    drawn = imperfection(problem.mesh.coordinates.shape, seed)
    values = np.zeros(len(problem.u.x.array))
    values[problem.unknowns.point_dofs] = problem.unknowns.at_points(drawn)
    return values[: problem.unknowns.owned]


def _potential(problem: EquilibriumProblem) -> float:
    """Potential energy in J; 0 if there is none, under pressures."""
    return 0.0 if problem.load.presses else problem.potential()


def with_stability(
    problem: EquilibriumProblem, report: SolveReport, settings: SolverSettings
) -> SolveReport:
    """Look at the stability of the equilibrium that was just found (collective).

    `problem` holds the stable equilibrium afterwards, or the unstable one if it is allowed, or if
    there is no other.

    Parameters
    ----------
    problem : EquilibriumProblem
    report : SolveReport
        How the equilibrium was found, by `solve_load_case` or `solve_from`.
    settings : SolverSettings
        `stability` says what becomes of an unstable one.

    Returns
    -------
    SolveReport
        Its iterations count those of leaving an unstable equilibrium as well.
    """
    if not report.solved or is_stable(problem):
        return report
    if settings.stability == "allow":
        return replace(report, stable=False)
    if settings.stability == "fail":
        return replace(report, solved=False, stable=False, explanation=UNSTABLE)
    found = relaxed(problem, settings.imperfection)
    return replace(
        report,
        solved=found.stable,
        stable=found.stable,
        left=found.stable,
        explanation=report.explanation if found.stable else NOT_LEFT,
        newton_iterations=report.newton_iterations + found.iterations,
        residual_norm=found.residual_norm,
    )
