r"""From an unstable equilibrium to a stable one: the body moves as in a viscous fluid.

The unstable state :math:`u^*` is disturbed along its lowest mode, and moves on by

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

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.solver.drag import Drag
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.stability.inertia import GROWTH, metric_of, shifted, unstable_modes
from shared_schema.common.bodies.equilibrium import imperfection, mean_edge

INVERSE_ITERATIONS = 30
AMPLITUDE = 0.1  # of the disturbance over the size of a cell
STEPS = 400
FEW = 5  # Newton iterations of an easy step
HALVINGS = 20
ROUNDING = 1e-12  # of energies, relative


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
