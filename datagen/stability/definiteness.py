r"""Stability of the equilibrium that Newton's method has found: a positive definite tangent.

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
- *Factors* L D Lᵀ (`datagen.stability.inertia`) else.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.stability.inertia import unstable_modes

REDUCTION = 1e-2  # of the residual, in the norm of the preconditioner
ITERATIONS = 60


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
