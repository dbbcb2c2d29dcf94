r"""Newton's method (PETSc SNES) for R(u) = 0.

.. math:: K(u_k) \, Δu_k = -R(u_k), \qquad u_{k+1} = u_k + Δu_k, \qquad K = ∂R/∂u

The iteration ends when :math:`‖R‖_2` is at most the tolerance
(`shared_schema.common.bodies.equilibrium`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from datagen.discretisation.element import ElementKind
from datagen.solver.corotation import Corotation
from datagen.solver.linear_solver import (
    INEXACT_TOLERANCE,
    Solver,
    set_up_direct,
    set_up_inertial,
    set_up_multigrid,
    set_up_preconditioned,
)
from datagen.solver.settings import SolverSettings
from shared_schema.common.bodies.equilibrium import RoundOff

EXACT = 1e-10  # relative tolerance of Krylov iterations under loads that rounding may hide
PREDICTING = 1e-4  # of those of nearly incompressible cells
LAST_STEP = 1e-3  # of the displacement: largest step after which the tangent before it will do


@dataclass(frozen=True)
class NewtonResult:
    """Outcome of one Newton solve.

    Attributes
    ----------
    converged : bool
    reason : int
        PETSc's SNESConvergedReason: positive if converged.
    explanation : str
        The reason in words.
    iterations : int
        Number of Newton iterations.
    residual_norm : float
        2-norm of the last residual, in N.
    """

    converged: bool
    reason: int
    explanation: str
    iterations: int
    residual_norm: float

    @property
    def linear_solve_failed(self) -> bool:
        """True if Newton's method stopped because the linear solver failed."""
        return bool(self.reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE)


class Equations(Protocol):
    """R and K, as SNES wants them."""

    kind: ElementKind
    dimension: int
    residual: PETSc.Vec
    matrix: PETSc.Mat
    points: NDArray[np.float64]

    def compute_residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """Replace b by R(x)."""

    def compute_tangent(self, snes: PETSc.SNES, x: PETSc.Vec, a: PETSc.Mat, p: PETSc.Mat) -> None:
        """Replace the matrix by K at the x that the residual was computed for."""

    def relative_tolerance(self, displacement_norm: float) -> float:
        """Tolerance on ‖R‖ in N by ‖u‖ in m, relative to the load."""


class Newton:
    """Newton's method with one linear solver, and with LU where that fails.

    Parameters
    ----------
    equations : Equations
    settings : SolverSettings
    linear_solver : {"lu", "multigrid", "corotated"}
    corotation : Corotation or None
        Preconditioner of the linear solver `corotated`.

    Attributes
    ----------
    snes : petsc4py.PETSc.SNES
        The Newton solver.
    is_direct : bool
        True if it solves the linear systems by LU.
    """

    def __init__(
        self,
        equations: Equations,
        settings: SolverSettings,
        linear_solver: Solver,
        corotation: Corotation | None,
    ) -> None:
        self._equations, self._settings, self._corotation = equations, settings, corotation
        self._at_least_one, self._limit = False, 0.0
        self.is_direct = linear_solver == "lu"
        self.snes = self._make_snes(linear_solver)
        self._direct = self.snes if self.is_direct else None  # else made when first needed
        self._inertial: PETSc.SNES | None = None
        self._used = self.snes

    def _make_snes(self, linear_solver: Solver | Literal["inertial"]) -> PETSc.SNES:
        settings, equations = self._settings, self._equations
        snes = PETSc.SNES().create(equations.residual.comm)
        snes.setFunction(equations.compute_residual, equations.residual)
        snes.setJacobian(equations.compute_tangent, equations.matrix)
        snes.setTolerances(rtol=0.0, atol=0.0, stol=0.0, max_it=settings.max_iterations)
        if settings.tolerance is None:
            snes.setConvergenceTest(self._has_converged)
        snes.setType("newtonls")
        if linear_solver == "inertial":
            set_up_inertial(snes)
        elif linear_solver == "lu":
            set_up_direct(snes, equations.dimension, equations.kind.has_pressure)
        elif self._corotation is None:
            set_up_multigrid(snes, equations.points)
        else:
            set_up_preconditioned(snes, self._corotation)
        return snes

    def _has_converged(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> int:
        """Convergence test for SNES, if the tolerance is relative; one iteration at least."""
        reasons = PETSc.SNES.ConvergedReason
        displacement, _, residual = norms
        if iteration == 0 and self._at_least_one:
            return int(reasons.ITERATING)
        small = residual <= self._equations.relative_tolerance(displacement)
        return int(reasons.CONVERGED_FNORM_ABS if small else reasons.ITERATING)

    def stop_at(self, tolerance: float, floor: float) -> None:
        """Set the absolute tolerance, if the settings have one, for the present load.

        Parameters
        ----------
        tolerance, floor : float
            Tolerance, and rounding errors that no stricter one goes below, in N.
        """
        self._limit = tolerance
        all_of_them = (self.snes, self.is_direct), (self._direct, True), (self._inertial, True)
        for snes, is_direct in all_of_them:
            if snes is not None:
                stricter = 1.0 if is_direct or self._corotation else INEXACT_TOLERANCE
                snes.setTolerances(atol=max(stricter * tolerance, min(tolerance, floor)))

    def solve(
        self,
        x: PETSc.Vec,
        is_loaded: bool,
        is_linear: bool,
        predicts: bool,
        direct: bool,
        inertial: bool = False,
    ) -> tuple[int, int, float]:
        """Iterate from x, which then holds the last iterate, converged or not.

        Parameters
        ----------
        x : PETSc.Vec
            Not the vector of the state itself.
        is_loaded : bool
            Make one iteration at least.
        is_linear : bool
            The load is so small that rounding may hide what a first, inexact step leaves.
        predicts : bool
            A step predicts pressures; an inexact one would predict wrong ones.
        direct : bool
            Solve the linear systems by LU in any case.
        inertial : bool
            Else solve them as those of time steps.

        Returns
        -------
        reason, iterations : int
        residual_norm : float
        """
        snes = self.snes
        if direct:
            snes = self._direct_snes()
        elif inertial:
            snes = self._inertial_snes()
        if snes not in (self._direct, self._inertial):
            snes.setUseEW(not is_linear and not predicts)
            if is_linear:
                snes.getKSP().setTolerances(rtol=EXACT)
            elif predicts:
                snes.getKSP().setTolerances(rtol=PREDICTING)
        self._at_least_one, self._used = is_loaded, snes
        snes.setForceIteration(is_loaded)
        snes.solve(None, x)
        return snes.getConvergedReason(), snes.getIterationNumber(), snes.getFunctionNorm()

    def _direct_snes(self) -> PETSc.SNES:
        if self._direct is None:
            self._direct = self._make_snes("lu")
            self._direct.setTolerances(atol=self._limit)
        return self._direct

    def iterate_in_time(self, most: int) -> None:
        """Set the largest number of iterations of time steps."""
        for snes in (self._direct_snes(), self._inertial_snes()):
            snes.setTolerances(max_it=most)

    def _inertial_snes(self) -> PETSc.SNES:
        if self._inertial is None:
            self._inertial = self._make_snes("inertial")
            self._inertial.setTolerances(atol=self._limit)
        return self._inertial

    def direct_solver(self) -> PETSc.KSP:
        """Solver of linear systems by LU."""
        return self._direct_snes().getKSP()

    @property
    def used_lu(self) -> bool:
        """True if the last solve solved its linear systems by LU."""
        return self._used is self._direct

    def last_tangent_is_of(self, x: PETSc.Vec) -> bool:
        """True if the last step to x was so small that the tangent before it is that at x."""
        if self._used.getIterationNumber() == 0:
            return False
        return bool(self._used.getSolutionUpdate().norm() <= LAST_STEP * x.norm())

    def pivots(self) -> NDArray[np.float64] | None:
        """Pivots of the last tangent, if it was factorised without an exchange of rows.

        PETSc's own LU has no such exchange. Of a symmetric matrix, as many pivots are negative as
        eigenvalues are (Sylvester's law of inertia).
        """
        pc = self._used.getKSP().getPC()
        if not self.used_lu or pc.getFactorSolverType() != "petsc":
            return None
        diagonal = pc.getFactorMatrix().getDiagonal()
        values: NDArray[np.float64] = diagonal.array_r.copy()
        diagonal.destroy()
        return values

    @contextmanager
    def symmetric_preconditioner(self) -> Iterator[Callable[[PETSc.Vec, PETSc.Vec], None]]:
        """Preconditioner of the Krylov iterations as (x, y) ↦ y = P x, with a symmetric P."""
        if self._corotation is None:
            yield self.snes.getKSP().getPC().apply
            return
        with self._corotation.symmetric() as apply:
            yield apply

    def close(self) -> None:
        """Release PETSc's memory."""
        self.snes.destroy()
        for snes in (self._direct, self._inertial):
            if snes is not None:
                snes.destroy()


def reason_name(reason: int) -> str:
    """Name of a SNESConvergedReason, as PETSc spells it."""
    names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
    return names.get(reason, str(reason))


def round_off(stiffness: PETSc.Mat, cell_size: float) -> RoundOff:
    """Estimate the rounding errors of residuals by K₀ in N/m and the cells' size (collective)."""
    diagonal = stiffness.getDiagonal()
    norm, largest = diagonal.norm(), diagonal.norm(PETSc.NormType.NORM_INFINITY)
    diagonal.destroy()
    return RoundOff.of(norm, largest, cell_size)
