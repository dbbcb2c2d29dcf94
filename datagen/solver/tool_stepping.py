"""A load case with a rigid tool: load stepping, and then multipliers of the contact."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.newton import NewtonResult
from datagen.solver.load_stepping import SolveReport, solve_load_case
from datagen.solver.settings import SolverSettings

Array = NDArray[np.float64]
SMOOTHING = 0.1, 0.01, 0.0  # of the depth, one after the other
PENETRATION = 1e-5  # of the depth: largest one of an equilibrium
UPDATES = 40  # of the multipliers, at most


@dataclass(frozen=True)
class Contact:
    """Contact in an equilibrium.

    Attributes
    ----------
    forces : array, (n_nodes, d)
        Forces of the tool on the nodes in N.
    penetration : float
        Largest depth of a node inside the tool in m.
    updates : int
        Of the multipliers.
    """

    forces: Array
    penetration: float
    updates: int

    @property
    def nodes(self) -> int:
        """Number of nodes that bear a force."""
        return int(self.forces.any(axis=1).sum())


def solve_with_tool(
    problem: EquilibriumProblem,
    nodes: NDArray[np.int64],
    forces: Array,
    settings: SolverSettings,
    pressures: Array | None = None,
    displacement: Array | None = None,
) -> tuple[SolveReport, Contact]:
    """Bring the body from rest to equilibrium with the tool of `problem.load` (collective).

    Parameters are those of `solve_load_case`; where the multipliers do not settle, the report says
    so.
    """
    contact = problem.load.contact
    assert contact is not None
    contact.multipliers[:] = 0.0
    contact.smoothing = SMOOTHING[0] * contact.depth
    report = solve_load_case(problem, nodes, forces, settings, pressures, displacement)
    for part in SMOOTHING[1:]:
        if report.solved:
            contact.smoothing = part * contact.depth
            report = after(report, problem.solve(1.0))
    u, updates = problem.displacement(), 0
    allowed = PENETRATION * contact.depth
    while report.solved and contact.penetration(u) > allowed:
        if updates == UPDATES:
            report = replace(report, solved=False, explanation="the contact does not settle")
            break
        contact.update(u)
        report = after(report, problem.solve(1.0))
        u, updates = problem.displacement(), updates + 1
    return report, Contact(contact.forces(u), contact.penetration(u), updates)


def after(report: SolveReport, result: NewtonResult) -> SolveReport:
    """The report after one more solve under the full load."""
    return replace(
        report,
        solved=result.converged,
        reason=result.reason,
        explanation=result.explanation,
        newton_iterations=report.newton_iterations + result.iterations,
        residual_norm=result.residual_norm,
    )
