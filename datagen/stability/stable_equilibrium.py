"""What becomes of an equilibrium: kept if it is stable, else left, refused or recorded as it is."""

from __future__ import annotations

from dataclasses import replace

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import SolveReport
from datagen.solver.settings import SolverSettings
from datagen.stability.definiteness import is_stable
from datagen.stability.relaxation import relaxed

UNSTABLE = "unstable equilibrium"
NOT_LEFT = "unstable equilibrium, and no stable one found from it"


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
