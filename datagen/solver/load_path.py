r"""Beyond a limit point of pressures: steps in volume instead of the load.

Where the pressure in a chamber has a maximum, no step of the load leads on. The path of equilibria
does: it is followed in steps of

.. math:: c(u) = f · u + \sum_j ± a_j \, q_j(u),

the volumes of chambers weighted with their pressures, with the load factor s as an unknown
(`datagen.solver.bordered_newton`). Steps grow and are cut back as those of the load. Where s
reaches 1, Newton's method finds the equilibrium under the full load. It may be far from those
before the limit point: a chamber that snaps through is larger. A path on which the load falls to
half is given up, as one of a balloon of Neo-Hooke, whose pressure never rises again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datagen.solver.bordered_newton import UnknownLoadFactor
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.newton import NewtonResult
from datagen.solver.settings import SolverSettings

GROWTH, CUT = 1.6, 0.5  # factors of the step
SMALLEST = 1e-3  # of the first one
LEAST = 0.5  # of the load factor at the begin, below which the path leads nowhere
MOST = 60  # steps
Array = NDArray[np.float64]


@dataclass(frozen=True)
class FollowedPath:
    """What it took.

    Attributes
    ----------
    result : NewtonResult or None
        The last one, if there was one.
    solved : bool
        The equilibrium under the full load was found.
    load_steps, newton_iterations : int
    """

    result: NewtonResult | None
    solved: bool
    load_steps: int
    newton_iterations: int


def follow_path(
    problem: EquilibriumProblem,
    before: Array,
    load_factor: float,
    settings: SolverSettings,
    begin: Callable[[float, float], None],
) -> FollowedPath:
    """Follow the path of equilibria from the last one to the full load (collective).

    `problem` holds the last equilibrium found afterwards.

    Parameters
    ----------
    problem : EquilibriumProblem
        At the last equilibrium.
    before : array
        State of the one before that, or of rest.
    load_factor : float
        That of the last equilibrium.
    settings : SolverSettings
    begin : callable
        Called at the begin of each step, with s twice.
    """
    path, here = UnknownLoadFactor(problem), problem.state()
    problem.restore(before)
    work = path.work(problem.displacement_of_points())
    problem.restore(here)
    reached, factor = path.work(problem.displacement_of_points()), load_factor
    first = step = path.scale = reached - work
    steps = iterations = 0
    result: NewtonResult | None = None
    while step >= SMALLEST * first > 0.0 and steps < MOST and factor > LEAST * load_factor:
        begin(factor, factor)
        path.given, problem.load_factor = reached + step, factor
        result = problem.solve_on_path(path)
        iterations += result.iterations
        easy, further = result.iterations <= settings.wanted_iterations, problem.load_factor
        if result.converged and further >= 1.0:
            result = problem.solve(1.0, direct=True)
            iterations += result.iterations
            if result.converged:
                return FollowedPath(result, True, steps + 1, iterations)
        if not result.converged:
            problem.restore(here)
            step *= CUT
            continue
        steps, reached, factor, here = steps + 1, path.given, further, problem.state()
        step *= GROWTH if easy else 1.0
    return FollowedPath(result, False, steps, iterations)
