r"""Adaptive load stepping: from the undeformed body to the equilibrium under the full load.

The load factor s grows from 0 to 1 in steps Δs. From the equilibrium at s, Newton's method seeks
the one at

.. math:: s' = \min(1, s + Δs).

- Newton's method begins on the path's power series, if there is one (`datagen.solver.load_series`),
  else at the last equilibrium.
- If it converges, s' becomes s. If it took few iterations (`wanted_iterations`), Δs is doubled.
- If it fails (no convergence, or an inverted element), the last equilibrium is restored and the
  step is cut back: Δs = (s' − s) / 2. Below `smallest_step` the load case counts as failed, unless
  chambers or cables act: then the path is followed on (`datagen.solver.load_path`).
- If it fails a second time in a row because the iterative linear solver failed, or while a tool
  touches the body, the same step is solved again by LU, and LU is used for the rest of the load
  case. (Forces of a tool are so stiff that inexact Newton steps may not converge.)
- With friction, which depends on the way, Δs is at most `FRICTION_STEP`, or `first_step` if that is
  less.

If a displacement u is given, such as the prediction of a network, Newton's method under the full
load starts from it if its potential energy

.. math:: Π(u) = E(u) - f · u

is below that of the undeformed body, which is 0. Its result is accepted if it converges to a state
of no higher energy. In all other cases the load is stepped up from rest, so a
poor displacement only costs extra iterations.

From rest, multigrid iterates to a hundredth of an absolute tolerance, and the last Krylov
iterations often to much less. From a given displacement both stop at the tolerance, since few
Newton steps follow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_path import follow_path
from datagen.solver.settings import SolverSettings
from shared_schema.actuators import Control
from shared_schema.common.solution_file import read_field
from shared_schema.samples.results import SolveReport

GROWTH, CUT = 2.0, 0.5  # factors of Δs
FRICTION_STEP = 0.05
Array = NDArray[np.float64]
KRYLOV = 0.3  # residual of the last Krylov iteration over the tolerance
SAME_PLACE = 1e-6  # largest difference of positions over the size of the mesh
ROUNDING = 1e-12  # of energies, relative: a start in equilibrium may end a little above itself


def solve_load_case(
    problem: EquilibriumProblem,
    nodes: NDArray[np.int64],
    forces: NDArray[np.float64],
    settings: SolverSettings,
    controls: Sequence[Control] = (),
    displacement: NDArray[np.float64] | None = None,
    begin: Callable[[float, float], None] = lambda reached, target: None,
    between: NDArray[np.float64] | None = None,
) -> SolveReport:
    """Bring the body from rest to equilibrium under a load (collective).

    `problem` holds the equilibrium afterwards, or the last one found if the load case failed.
    Failure raises nothing; it is reported in the result.

    Parameters
    ----------
    problem : EquilibriumProblem
    nodes : array of int, (n_loads,)
        Loaded nodes, by node number; the same on every rank.
    forces : array, (n_loads, d)
        Force vector at each of them, in N; the same on every rank.
    settings : SolverSettings
    controls, displacement, between
        As for `EquilibriumProblem.set_load`; they grow with the load factor as well.
    begin : callable
        Called on every rank at the begin of each load step, with s and s'.
    """
    problem.set_load(nodes, forces, controls, displacement, between)
    contact = problem.load.contact
    touched, rubs = contact is not None, contact is not None and contact.friction is not None
    longest = min(settings.first_step, FRICTION_STEP) if rubs else 1.0
    dead = not (problem.is_linear or touched or problem.load.is_bordered)
    series = problem.series if dead else None
    if series is not None:
        series.expand()
    problem.reset()
    equilibrium = before = problem.state()
    factor, step = 0.0, min(settings.first_step, longest)
    steps = cutbacks = iterations = 0
    direct, fails = problem.newton.is_direct, False
    while True:
        target = min(1.0, factor + step)
        begin(factor, target)
        if series is not None:
            series.begin(target)
        result = problem.solve(target, direct)
        iterations += result.iterations
        if result.converged:
            factor, steps, fails = target, steps + 1, False
            if contact is not None:
                contact.settle(problem.displacement(), factor)
            if factor == 1.0:
                break
            before, equilibrium = equilibrium, problem.state()
            if series is not None:
                series.pass_through(factor)
            if result.iterations <= settings.wanted_iterations:
                step = min(GROWTH * step, longest)
        elif (result.linear_solve_failed or touched) and fails and not direct:
            problem.restore(equilibrium)
            direct = True
        else:
            problem.restore(equilibrium)
            cutbacks += 1
            fails = result.linear_solve_failed or touched
            step = CUT * (target - factor)
            if step < settings.smallest_step:
                if factor > 0.0 and problem.has_path:
                    way = follow_path(problem, before, factor, settings, begin)
                    steps, iterations = steps + way.load_steps, iterations + way.newton_iterations
                    result, factor = way.result or result, 1.0 if way.solved else factor
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


def solve_from(
    displacement: Array,
    problem: EquilibriumProblem,
    nodes: NDArray[np.int64],
    forces: Array,
    settings: SolverSettings,
    begin: Callable[[float, float], None] = lambda reached, target: None,
    between: Array | None = None,
) -> tuple[SolveReport, bool]:
    """Bring the body to equilibrium under dead forces, starting from a displacement (collective).

    Parameters
    ----------
    displacement : array, (n_nodes, d)
        In m; what it says of clamped nodes is ignored. It may hold anything, NaN included.
    problem, nodes, forces, settings, begin, between
        As for `load_stepping.solve_load_case`.

    Returns
    -------
    report : SolveReport
        The iterations count all attempts.
    used : bool
        True if the start led to the equilibrium; false if the load was stepped up from rest.
    """
    problem.set_load(nodes, forces, between=between)
    problem.set_displacement(displacement)
    problem.supports.hold()
    energy, iterations = problem.potential(), 0
    if energy < 0.0:
        begin(0.0, 1.0)
        with no_further_than(problem.tolerance() if settings.tolerance else None, problem):
            result = problem.solve(1.0)
        iterations = result.iterations
        if result.converged and problem.potential() <= energy + ROUNDING * abs(energy):
            report = SolveReport(
                solved=True,
                reason=result.reason,
                explanation=result.explanation,
                load_factor=1.0,
                load_steps=1,
                cutbacks=0,
                newton_iterations=iterations,
                residual_norm=result.residual_norm,
            )
            return report, True
    report = solve_load_case(problem, nodes, forces, settings, begin=begin, between=between)
    return replace(report, newton_iterations=report.newton_iterations + iterations), False


@contextmanager
def no_further_than(tolerance: float | None, problem: EquilibriumProblem) -> Iterator[None]:
    """Let Newton's method with multigrid stop at a tolerance in N, its Krylov iterations below.

    Where the tolerance is relative to the load (None), it stops there in any case.
    """
    if problem.newton.is_direct or tolerance is None:
        yield
        return
    snes, ksp = problem.newton.snes, problem.newton.snes.getKSP()
    newton, krylov = snes.getTolerances(), ksp.getTolerances()
    snes.setTolerances(atol=tolerance)
    ksp.setTolerances(atol=KRYLOV * tolerance)
    try:
        yield
    finally:
        snes.setTolerances(*newton)
        ksp.setTolerances(*krylov)


def read_start(path: Path, coordinates: Array) -> Array:
    """Read the displacement of a solution file (``.npz``) of the same mesh.

    Raises
    ------
    InputError
        If the file is no such file, or is of another mesh.
    """
    return read_field(path, "displacement", coordinates, "--start", SAME_PLACE)
