"""The linear solves of Newton's method: direct, or GMRES with algebraic multigrid."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

GAMG_OPTIONS = {
    "pc_gamg_agg_nsmooths": 1,
    "pc_gamg_threshold": 0.02,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_esteig_ksp_type": "cg",
    "mg_levels_pc_type": "jacobi",
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "lu",
}
RESTART, MAX_ITERATIONS = 100, 200
INEXACT_NEWTON = {  # relative tolerance of the inner solve in step k: γ (‖R_k‖ / ‖R_k-1‖)^α
    "snes_ksp_ew": None,  # Eisenstat and Walker (1996), choice 2
    "snes_ksp_ew_version": 2,
    "snes_ksp_ew_rtol0": 1e-2,
    "snes_ksp_ew_rtolmax": 1e-2,
    "snes_ksp_ew_gamma": 0.5,
    "snes_ksp_ew_alpha": 1.618,
}
INEXACT_TOLERANCE = 1e-2  # part of the tolerance to go on to, where steps are inexact: solutions
# then agree to some 1e-10 of their size, however the inner solves were rounded and broken off

FULL_STEPS = {"snes_linesearch_type": "basic"}
BUILT_ONCE = {"snes_lag_preconditioner": -2}  # at the first tangent, then never again


def set_up_direct(snes: PETSc.SNES, dimension: int) -> None:
    """LU of every tangent: PETSc's own in the plane on one rank, else MUMPS."""
    _from_options(snes, FULL_STEPS)
    ksp = snes.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("petsc" if ksp.comm.size == 1 and dimension == 2 else "mumps")


def set_up_multigrid(snes: PETSc.SNES, points: NDArray[np.float64]) -> None:
    """Inexact Newton steps by GMRES, preconditioned by a multigrid hierarchy that is built once.

    The hierarchy is that of the undeformed body, so that no solve depends on those before it. It is
    GMRES, since conjugate gradients give up where the tangent is not positive definite, as it may
    be on the way to a large deformation.

    Parameters
    ----------
    snes : PETSc.SNES
        With function and tangent set.
    points : array, (n_owned_nodes, d)
        Positions of this rank's nodes in the order of their degrees of freedom, in m.
    """
    _from_options(snes, FULL_STEPS | BUILT_ONCE | INEXACT_NEWTON)
    snes.setUp()
    tangent, _, _ = snes.getJacobian()
    undeformed = tangent.createVecRight()
    snes.computeJacobian(undeformed, tangent)
    tangent.setNearNullSpace(rigid_body_modes(tangent, points))
    ksp = snes.getKSP()
    ksp.setType("gmres")
    ksp.setGMRESRestart(RESTART)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setTolerances(atol=0.0, max_it=MAX_ITERATIONS)
    ksp.getPC().setType("gamg")
    _from_options(ksp, GAMG_OPTIONS)
    ksp.setOperators(tangent)
    ksp.setUp()


def rigid_body_modes(matrix: PETSc.Mat, points: NDArray[np.float64]) -> PETSc.NullSpace:
    """Translations and infinitesimal rotations of a body, orthonormal over all ranks.

    Parameters
    ----------
    matrix : PETSc.Mat
        Its layout is that of the vectors.
    points : array, (n_owned_nodes, d)
        In m.
    """
    dimension = points.shape[1]
    modes = []
    for axis in range(dimension):
        modes.append(np.zeros_like(points))
        modes[-1][:, axis] = 1.0
    for a in range(dimension):
        for b in range(a + 1, dimension):
            modes.append(np.zeros_like(points))
            modes[-1][:, a], modes[-1][:, b] = -points[:, b], points[:, a]
    basis: list[PETSc.Vec] = []
    for mode in modes:
        vector = matrix.createVecLeft()
        vector.array_w[:] = mode.ravel()
        for other in basis:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
        basis.append(vector)
    return PETSc.NullSpace().create(vectors=basis, comm=matrix.comm)


def _from_options(solver: Any, options: dict[str, Any]) -> None:
    """Configure one solver by options that no other sees and that do not stay behind."""
    prefix = f"solver_{solver.handle}_"
    solver.setOptionsPrefix(prefix)
    database = PETSc.Options()
    for name, value in options.items():
        database[prefix + name] = value
    solver.setFromOptions()
    for name in options:
        database.delValue(prefix + name)
