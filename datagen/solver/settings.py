"""How the nonlinear equations are solved and the load is stepped."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from shared_schema.common.configuration import Frozen

LinearSolver = Literal["lu", "multigrid"]


class SolverSettings(Frozen):
    """Newton's method and load stepping (defaults: AceFEM's in the authors' scripts).

    Attributes
    ----------
    tolerance : float
        Absolute tolerance on the 2-norm of the residual, in N.
    max_iterations : int
        Newton iterations allowed in one load step.
    wanted_iterations : int
        A load step that needs no more than these lets the next one grow.
    first_step : float
        First load step, as a fraction of the load.
    linear_solver : {"lu", "multigrid"}
        Of the Newton steps: direct, or GMRES with algebraic multigrid, which pays
        from some ten thousand degrees of freedom on.
    smallest_step : float
        Load step, as a fraction of the load, below which the load case counts as failed.
    """

    tolerance: float = Field(1e-8, gt=0)
    max_iterations: int = Field(15, gt=0)
    wanted_iterations: int = Field(8, gt=0)
    first_step: float = Field(1.0, gt=0, le=1)
    linear_solver: LinearSolver = "lu"
    smallest_step: float = Field(1e-3, gt=0, le=1)
