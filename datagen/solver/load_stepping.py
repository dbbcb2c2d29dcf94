"""Adaptive load stepping: from the undeformed body to the equilibrium under the full load.

A step that fails (no convergence, or an inverted element) is cut back and tried again from the
last equilibrium; a step that converges in few iterations lets the next one grow. Where an iterative
linear solver gives up, the rest of the load case is solved directly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.settings import SolverSettings

GROWTH, CUT = 2.0, 0.5


@dataclass(frozen=True)
class SolveReport:
    """How one load case was solved.

    Attributes
    ----------
    solved : bool
    reason : int
        PETSc's SNESConvergedReason of the last Newton solve.
    explanation : str
        The reason in words.
    load_factor : float
        Part of the load at the last equilibrium: 1 if solved.
    load_steps : int
        Load steps that converged.
    cutbacks : int
        Load steps that failed and were cut back.
    newton_iterations : int
        Over all steps, failed ones as well.
    residual_norm : float
        2-norm of the residual of the last Newton solve, in N.
    """

    solved: bool
    reason: int
    explanation: str
    load_factor: float
    load_steps: int
    cutbacks: int
    newton_iterations: int
    residual_norm: float


def solve_load_case(
    problem: EquilibriumProblem,
    nodes: NDArray[np.int64],
    forces: NDArray[np.float64],
    settings: SolverSettings,
) -> SolveReport:
    """Bring the body from rest to equilibrium under nodal forces; the result stays in `problem`.

    Parameters
    ----------
    problem : EquilibriumProblem
        Collective over its ranks.
    nodes : array of int, (n_loads,)
        Loaded nodes, by node number.
    forces : array, (n_loads, d)
        Force vectors in N.
    settings : SolverSettings
    """
    problem.reset()
    problem.set_load(nodes, forces)
    equilibrium = problem.state()
    factor, step = 0.0, settings.first_step
    steps = cutbacks = iterations = 0
    direct = problem.is_direct
    while True:
        target = min(1.0, factor + step)
        result = problem.solve(target, direct)
        iterations += result.iterations
        if result.converged:
            factor, steps = target, steps + 1
            if factor == 1.0:
                break
            equilibrium = problem.state()
            if result.iterations <= settings.wanted_iterations:
                step *= GROWTH
        elif result.linear_solve_failed and not direct:
            problem.restore(equilibrium)
            direct = True
        else:
            problem.restore(equilibrium)
            cutbacks += 1
            step = CUT * (target - factor)
            if step < settings.smallest_step:
                break
    return SolveReport(
        solved=factor == 1.0,
        reason=result.reason,
        explanation=result.explanation,
        load_factor=factor,
        load_steps=steps,
        cutbacks=cutbacks,
        newton_iterations=iterations,
        residual_norm=result.residual_norm,
    )
