"""Settings of Newton's method, the linear solver and the load stepping (`solver` in a case)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen

LinearSolver = Literal["lu", "multigrid"]


class SolverSettings(Frozen):
    """Settings of the solver; the defaults are those of AceFEM in the authors' scripts.

    Attributes
    ----------
    tolerance : float
        Absolute tolerance on the 2-norm of the residual, in N.
    max_iterations : int
        Largest number of Newton iterations in one load step.
    wanted_iterations : int
        The next load step is larger if a step needs at most this many Newton iterations.
    first_step : float
        Size of the first load step, as a fraction of the load.
    linear_solver : {"lu", "multigrid"}
        Linear solver of the Newton steps: LU, or GMRES with algebraic multigrid, which is faster
        from about ten thousand degrees of freedom on.
    smallest_step : float
        Size of a load step, as a fraction of the load, below which the load case counts as failed.
    """

    tolerance: float = Field(1e-8, ge=1e-300, le=1e12)
    max_iterations: int = Field(15, gt=0, le=10_000)
    wanted_iterations: int = Field(8, gt=0, le=10_000)
    first_step: float = Field(1.0, ge=1e-9, le=1)
    linear_solver: LinearSolver = "lu"
    smallest_step: float = Field(1e-3, ge=1e-9, le=1)
