"""Load cases of one shard, solved one after the other."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from datagen.cases.body import Body
from datagen.cases.case import Case
from datagen.ranks import on_rank_zero
from datagen.solver.following_loads import found_actuation
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.tool_contact import INSIDE, touched
from datagen.stability import with_stability
from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError
from shared_schema.samples.results import Result, not_begun, result_arrays
from shared_schema.tools import Sphere


@dataclass
class ShardJob:
    """Load cases of one shard, solved one after the other by a group of ranks.

    Every rank of the group holds the job and all its results.

    Attributes
    ----------
    case : Case
    body : Body
        Body of the group; `solve_next` is collective over its ranks.
    numbers : sequence of int
        Sample numbers of the load cases, in the order of solution.
    results : list of Result
        Of the load cases so far.
    """

    case: Case
    body: Body
    numbers: Sequence[int]
    results: list[Result] = field(default_factory=list)

    @property
    def done(self) -> int:
        """Number of load cases that are solved or failed."""
        return len(self.results)

    @property
    def solved(self) -> list[Result]:
        """Results with an equilibrium."""
        return [result for result in self.results if result.report.solved]

    @property
    def failed(self) -> list[Result]:
        """Results without an equilibrium."""
        return [result for result in self.results if not result.report.solved]

    @property
    def is_complete(self) -> bool:
        """True if every load case is solved or failed."""
        return self.done == len(self.numbers)

    @property
    def number(self) -> int:
        """Sample number of the next load case."""
        return self.numbers[self.done]

    def solve_next(self) -> bool:
        """Solve the next load case (collective); return True if an equilibrium was found.

        Raises
        ------
        InputError
            On every rank of the group, if the load family draws no load case.
        """
        body, shapes, number = self.body, self.body.mesh.shapes, self.number
        if shapes is None:
            return self._solve(body)
        values = shapes.drawn(self.case.dataset.seed, number)
        tangled = shapes.problem(values, body.mesh.cells, body.mesh.cell_type)
        if tangled is not None:
            self.results.append(not_begun(number, body.of_shape(values).loads[number], tangled))
            return False
        body = body.reshaped(values)
        try:
            return self._solve(body)
        finally:
            body.problem.close()

    def _solve(self, body: Body) -> bool:
        """Solve the next load case on a body (collective)."""
        case, problem, number = self.case, body.problem, self.number
        load = on_rank_zero(body.mesh.domain.comm, lambda: body.loads[number])
        began = time.perf_counter()
        self._put(body, load.tool)
        acting = problem, load.nodes, load.forces, case.solver
        driven = load.controls, load.displacement
        report = solve_load_case(*acting, *driven, between=load.between)
        report = with_stability(problem, report, case.solver)
        elapsed = time.perf_counter() - began
        grip = None if load.is_dead else problem.grip()
        displacement, touch = problem.displacement(), problem.load.contact
        contact = None if touch is None else touch.found(displacement)
        if contact is not None and contact.penetration > INSIDE * np.ptp(body.mesh.coordinates):
            report = replace(report, solved=False, explanation="a node is inside the tool")
        actuated = found_actuation(problem, len(load.actuation))
        if report.solved and (said := body.loads.actuators.wall_problem(problem.positions())):
            report = replace(report, solved=False, explanation=said)
        self.results.append(
            Result(number, load, grip, contact, displacement, report, elapsed, actuated)
        )
        return report.solved

    def _put(self, body: Body, tool: Sphere | None) -> None:
        """Put the tool where it shall be, or away (collective)."""
        problem = body.problem
        problem.load.contact = None
        if tool is None:
            return
        problem.reset()
        try:
            problem.load.contact = touched(problem, tool, body.surface)
        except InputError as error:
            raise InputError(f"sample {self.number}: {error}") from None

    def size_warning(self) -> str | None:
        """What is unusual about the size of the displacements so far, if anything is."""
        displacement = np.array([result.displacement for result in self.solved])
        what = f"the largest displacement of the first {len(displacement)} samples"
        return size_warning(displacement, self.body.mesh.coordinates, what)

    def arrays(self) -> dict[str, Any]:
        """Results so far as arrays, by their paths in the schema of a nodal shard."""
        return self.body.shard_arrays() | result_arrays(
            self.body.loads, self.results, self.body.mesh.shapes
        )
