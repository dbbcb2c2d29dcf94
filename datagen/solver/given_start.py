r"""Equilibrium from a given displacement, such as the prediction of a network.

Newton's method under the full load starts from the given displacement u if its potential energy

.. math:: Π(u) = E(u) - f · u

is below that of the undeformed body, which is 0. Its result is accepted if it converges to a state
of no higher energy. In all other cases the load is stepped up from rest (`load_stepping`), so a
poor displacement only costs extra iterations.

From rest, multigrid iterates to a hundredth of an absolute tolerance, and the last Krylov
iterations often to much less. From a given displacement both stop at the tolerance, since few
Newton steps follow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import SolveReport, solve_load_case
from datagen.solver.settings import SolverSettings
from shared_schema.common.solution_file import read_field

Array = NDArray[np.float64]
KRYLOV = 0.3  # residual of the last Krylov iteration over the tolerance
SAME_PLACE = 1e-6  # largest difference of positions over the size of the mesh
ROUNDING = 1e-12  # of energies, relative: a start in equilibrium may end a little above itself


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
