r"""Linear solves K Δu = −R of Newton's method: LU, or GMRES with algebraic multigrid.

With multigrid the steps are inexact: step k stops its Krylov iteration when

.. math:: ‖K Δu + R_k‖ \le η_k ‖R_k‖, \qquad η_k = γ (‖R_k‖ / ‖R_{k-1}‖)^α

(Eisenstat and Walker 1996, choice 2), so that early steps are cheap and late ones accurate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import ElementKind
from datagen.solver.settings import LinearSolver
from shared_schema.common.errors import InputError, WorkError

Solver = Literal["lu", "multigrid", "corotated"]
CROSSOVER = {2: 8_000, 3: 2_000}  # unknowns from which on multigrid is faster than LU, by d

GAMG_OPTIONS = {"pc_gamg_agg_nsmooths": 1, "pc_gamg_threshold": 0.02}
CASCADE_OPTIONS = GAMG_OPTIONS | {  # from coarse to fine, one incomplete Cholesky step on each
    "pc_mg_type": "kaskade",
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "bjacobi",
    "mg_levels_sub_pc_type": "icc",  # unlike Gauss-Seidel it bears singular blocks of coarse levels
}
RESTART, MAX_ITERATIONS = 100, 200
WITH_INERTIA = 1e-3  # relative tolerance of the Krylov iterations in time steps
INEXACT_NEWTON = {  # the relative tolerance η_k of the Krylov iteration in step k
    "snes_ksp_ew": None,
    "snes_ksp_ew_version": 2,
    "snes_ksp_ew_rtol0": 1e-2,
    "snes_ksp_ew_rtolmax": 1e-2,
    "snes_ksp_ew_gamma": 0.5,
    "snes_ksp_ew_alpha": 1.618,
}
# Inexact steps iterate until ‖R‖ is 1e-2 of the tolerance: solutions then agree to about 1e-10 of
# their size, whatever the rounding and the last iteration of the Krylov solves.
INEXACT_TOLERANCE = 1e-2

WORKSPACE = (20, 100, 500)  # per cent that MUMPS gets beyond its estimate, ICNTL(14)

FULL_STEPS = {"snes_linesearch_type": "basic"}
BUILT_ONCE = {"snes_lag_preconditioner": -2}  # PETSc: build at the first tangent, never again


def chosen_solver(wanted: LinearSolver, kind: ElementKind, dimension: int, dofs: int) -> Solver:
    """Linear solver of a problem, where the settings leave the choice.

    Parameters
    ----------
    wanted : {"auto", "lu", "multigrid", "corotated"}
    kind : ElementKind
    dimension : int
        Number of space dimensions d.
    dofs : int
        Number of unknowns.

    Raises
    ------
    InputError
        If multigrid is wanted for an element with pressures.
    """
    if kind.has_pressure and wanted == "multigrid":
        raise InputError(
            "key 'solver.linear_solver' = 'multigrid': expected auto, lu or corotated for "
            "incompressible triangles or tetrahedra, whose pressures are unknowns"
        )
    if wanted != "auto":
        return wanted
    return "lu" if dofs < CROSSOVER[dimension] else "corotated"


def set_up_direct(snes: PETSc.SNES, dimension: int, indefinite: bool = False) -> None:
    """Solve each step by LU: PETSc's own in the plane on one rank, else MUMPS.

    Parameters
    ----------
    snes : PETSc.SNES
    dimension : int
        Number of space dimensions d.
    indefinite : bool
        The tangent has zeros on its diagonal, so that rows must be exchanged (MUMPS).
    """
    _from_options(snes, FULL_STEPS)
    ksp = snes.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    own = ksp.comm.size == 1 and dimension == 2 and not indefinite
    ksp.getPC().setFactorSolverType("petsc" if own else "mumps")


def set_up_multigrid(snes: PETSc.SNES, points: NDArray[np.float64]) -> None:
    """Solve inexact steps by GMRES, preconditioned by a multigrid hierarchy built once, here.

    The hierarchy is built from the tangent of the undeformed body, so that no load case depends on
    those solved before it. The Krylov method is GMRES, because conjugate gradients fail where the
    tangent is not positive definite, which happens under large deformations.

    Parameters
    ----------
    snes : PETSc.SNES
        Its residual and tangent functions must be set.
    points : array, (n_owned_nodes, d)
        Positions in m of the nodes that this rank owns, in the order of their degrees of freedom.
    """
    _from_options(snes, FULL_STEPS | BUILT_ONCE | INEXACT_NEWTON)
    snes.setUp()
    tangent, _, _ = snes.getJacobian()
    undeformed = tangent.createVecRight()
    snes.computeJacobian(undeformed, tangent)
    tangent.setNearNullSpace(rigid_body_modes(tangent, points))
    ksp = snes.getKSP()
    set_up_gmres(ksp)
    ksp.getPC().setType("gamg")
    _from_options(ksp, GAMG_OPTIONS)
    ksp.setOperators(tangent)
    ksp.setUp()


def set_up_preconditioned(snes: PETSc.SNES, preconditioner: Any) -> None:
    """Solve inexact steps by GMRES with a preconditioner of our own.

    Parameters
    ----------
    snes : PETSc.SNES
    preconditioner : object
        Context of PETSc's type ``python``, with a method ``apply(pc, x, y)``.
    """
    _from_options(snes, FULL_STEPS | INEXACT_NEWTON)
    ksp = snes.getKSP()
    set_up_gmres(ksp)
    ksp.getPC().setType("python")
    ksp.getPC().setPythonContext(preconditioner)


def set_up_inertial(snes: PETSc.SNES) -> None:
    """Solve each step by GMRES with incomplete factors, which inertia makes accurate.

    The springs k M of a time step (`shared_schema.motion.scheme`) bound the condition number; the
    factors take a hundredth of the time of LU.
    """
    _from_options(snes, FULL_STEPS)
    ksp = snes.getKSP()
    set_up_gmres(ksp)
    ksp.setTolerances(rtol=WITH_INERTIA)
    ksp.getPC().setType("bjacobi")


def multigrid(matrix: PETSc.Mat, points: NDArray[np.float64], options: dict[str, Any]) -> PETSc.PC:
    """Build the hierarchy of a positive definite matrix.

    Parameters
    ----------
    matrix : PETSc.Mat
    points : array, (n_owned_points, d)
        Positions in m of the points that this rank owns, in the order of their degrees of freedom.
    options : dict
        `CASCADE_OPTIONS` for a cycle from coarse to fine, `GAMG_OPTIONS` for one that goes down and
        up, which takes three times as long and converges on more bodies.
    """
    matrix.setNearNullSpace(rigid_body_modes(matrix, points))
    pc = PETSc.PC().create(matrix.comm)
    pc.setOperators(matrix)
    pc.setType("gamg")
    _from_options(pc, options, pc.setUp)
    return pc


def factors(matrix: PETSc.Mat, definite: bool) -> PETSc.PC:
    """Factorise a matrix by MUMPS, as an operator that applies its inverse (collective).

    Parameters
    ----------
    matrix : PETSc.Mat
    definite : bool
        It is symmetric and positive definite: Cholesky's factor is applied twice as fast as LU.

    Raises
    ------
    WorkError
        If MUMPS fails. What memory it needs depends on how the ranks share the work, which differs
        from time to time; where its estimate is too small, it gets more.
    """
    if definite:
        matrix.setOption(PETSc.Mat.Option.SPD, True)
    for percent in WORKSPACE:
        pc = PETSc.PC().create(matrix.comm)
        pc.setOperators(matrix)
        pc.setType("cholesky" if definite else "lu")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(14, percent)
        pc.setUp()
        ending = factor.getMumpsInfog(1)
        if ending >= 0:
            return pc
        pc.destroy()
    raise WorkError(f"MUMPS cannot factorise the undeformed body's tangent (INFOG(1) = {ending})")


def set_up_gmres(ksp: PETSc.KSP) -> None:
    """Use GMRES, preconditioned from the right, so that it sees true residuals."""
    ksp.setType("gmres")
    ksp.setGMRESRestart(RESTART)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setTolerances(atol=0.0, max_it=MAX_ITERATIONS)


def rigid_body_modes(matrix: PETSc.Mat, points: NDArray[np.float64]) -> PETSc.NullSpace:
    """Translations and infinitesimal rotations of a body: 3 modes in the plane, 6 in space.

    They span the null space of the tangent of the undeformed body without supports; multigrid needs
    its coarse spaces to represent them. The modes are orthonormal.

    Parameters
    ----------
    matrix : PETSc.Mat
        Matrix whose row layout the vectors of the modes take.
    points : array, (n_owned_nodes, d)
        Positions in m of the nodes that this rank owns, in the order of their degrees of freedom.
    """
    x = matrix.createVecLeft()
    x.setBlockSize(points.shape[1])
    x.array_w[:] = points.ravel()
    modes = PETSc.NullSpace().createRigidBody(x)
    x.destroy()
    return modes


def _from_options(
    solver: Any, options: dict[str, Any], build: Callable[[], None] = lambda: None
) -> None:
    """Configure one solver by options under a prefix of its own, removed again afterwards.

    Levels of multigrid read theirs when they are built, by `build`.
    """
    prefix = f"solver_{solver.handle}_"
    solver.setOptionsPrefix(prefix)
    database = PETSc.Options()
    for name, value in options.items():
        database[prefix + name] = value
    solver.setFromOptions()
    build()
    for name in options:
        database.delValue(prefix + name)
