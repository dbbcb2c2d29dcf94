"""Settings of Newton's method, the linear solver and the load stepping (`solver` in a case)."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from shared_schema.common.configuration import Frozen
from shared_schema.common.units import Seed

LinearSolver = Literal["auto", "lu", "multigrid", "corotated"]
Stability = Literal["follow", "fail", "allow"]


class SolverSettings(Frozen):
    """Settings of the solver; the defaults of the load stepping are those of AceFEM.

    Attributes
    ----------
    tolerance : float, optional
        Absolute tolerance on the 2-norm of the residual, in N; at most 1e-6 of the load counts.
    relative_tolerance : float
        Tolerance on the 2-norm of the residual, as a fraction of that of the external forces. The
        residual need not fall below what rounding leaves of it
        (`shared_schema.common.bodies.equilibrium`).
    max_iterations : int
        Largest number of Newton iterations in one load step.
    wanted_iterations : int
        The next load step is larger if a step needs at most this many Newton iterations.
    first_step : float
        Size of the first load step, as a fraction of the load.
    linear_solver : {"auto", "lu", "multigrid", "corotated"}
        Linear solver of the Newton steps: LU; GMRES with algebraic multigrid of the undeformed
        body; the same with a hierarchy that turns with the body; or the fastest for the mesh and
        its elements.
    smallest_step : float
        Size of a load step, as a fraction of the load, below which the load case counts as failed.
    stability : {"follow", "fail", "allow"}
        What becomes of an unstable equilibrium: it is left for a stable one, the load case counts
        as failed, or it is recorded as it is.
    imperfection : int
        Seed of the small disturbance of the body that decides in which direction an unstable
        equilibrium is left; the same for all load cases.
    """

    tolerance: float | None = Field(None, ge=1e-300, le=1e12)
    relative_tolerance: float = Field(1e-9, ge=1e-15, le=1e-2)
    max_iterations: int = Field(15, gt=0, le=10_000)
    wanted_iterations: int = Field(8, gt=0, le=10_000)
    first_step: float = Field(1.0, ge=1e-9, le=1)
    linear_solver: LinearSolver = "auto"
    smallest_step: float = Field(1e-3, ge=1e-9, le=1)
    stability: Stability = Field("follow", exclude_if=lambda wanted: wanted == "follow")
    imperfection: Seed = Field(0, exclude_if=lambda seed: seed == 0)

    @model_validator(mode="after")
    def _has_one_tolerance(self) -> SolverSettings:
        if self.tolerance is not None and "relative_tolerance" in self.model_fields_set:
            raise ValueError("tolerance and relative_tolerance: expected one of them")
        return self

    @model_serializer(mode="wrap")
    def _with_one_tolerance(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the unused tolerance; so cases with an absolute one keep their digest."""
        content: dict[str, Any] = plain(self)
        del content["tolerance" if self.tolerance is None else "relative_tolerance"]
        return content
