"""Load cases of one shard: solving them, and converting the results to the schema's arrays."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.body import Body
from datagen.cases.case import Case
from datagen.ranks import on_rank_zero
from datagen.solver.load_stepping import SolveReport, solve_load_case
from datagen.solver.tool_contact import INSIDE, touched
from datagen.stability import with_stability
from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.loads import Load, Recorded
from shared_schema.tools import Contact, Sphere

OF_REPORT = (  # datasets below ``samples/``, with attributes and types of a report
    ("converged_reason", "reason", np.int64),
    ("load_steps", "load_steps", np.int64),
    ("cutbacks", "cutbacks", np.int64),
    ("newton_iterations", "newton_iterations", np.int64),
    ("residual_norm", "residual_norm", np.float64),
    ("stable", "stable", np.bool_),
)


@dataclass(frozen=True)
class Result:
    """A load case, solved or failed.

    Attributes
    ----------
    number : int
        Sample number.
    load : Load
    grip : array, (n_points, d), or None
        Forces that hold prescribed displacements, in N; None of a dead load.
    contact : Contact or None
        Of the tool.
    displacement : array, (n_nodes, d)
        In m.
    report : SolveReport
    wall_time : float
        In s.
    """

    number: int
    load: Load
    grip: NDArray[np.float64] | None
    contact: Contact | None
    displacement: NDArray[np.float64]
    report: SolveReport
    wall_time: float


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
        case, problem = self.case, self.body.problem
        number, loads = self.number, self.body.loads
        load = on_rank_zero(self.body.mesh.domain.comm, lambda: loads[number])
        began = time.perf_counter()
        self._put(load.tool)
        acting = problem, load.nodes, load.forces, case.solver
        driven = load.pressures, load.displacement
        report = solve_load_case(*acting, *driven, between=load.between)
        report = with_stability(problem, report, case.solver)
        elapsed = time.perf_counter() - began
        grip = None if load.is_dead else problem.grip()
        displacement, touch = problem.displacement(), problem.load.contact
        contact = None if touch is None else touch.found(displacement)
        if contact is not None and contact.penetration > INSIDE * np.ptp(
            self.body.mesh.coordinates
        ):
            report = replace(report, solved=False, explanation="a node is inside the tool")
        self.results.append(Result(number, load, grip, contact, displacement, report, elapsed))
        return report.solved

    def _put(self, tool: Sphere | None) -> None:
        """Put the tool where it shall be, or away (collective)."""
        problem = self.body.problem
        problem.load.contact = None
        if tool is None:
            return
        problem.reset()
        try:
            problem.load.contact = touched(problem, tool, self.body.surface)
        except InputError as error:
            raise InputError(f"sample {self.number}: {error}") from None

    def size_warning(self) -> str | None:
        """What is unusual about the size of the displacements so far, if anything is."""
        displacement = np.array([result.displacement for result in self.solved])
        what = f"the largest displacement of the first {len(displacement)} samples"
        return size_warning(displacement, self.body.mesh.coordinates, what)

    def arrays(self) -> dict[str, Any]:
        """Results so far as arrays, by their paths in the schema of a nodal shard."""
        body, dimension = self.body, self.body.mesh.coordinates.shape[1]
        width = body.loads.most
        solved, failed = self.solved, self.failed
        of_solved, of_failed = ([self._recorded(r) for r in some] for some in (solved, failed))
        loaded_nodes, force = _pad(of_solved, width, dimension)
        failed_nodes, failed_force = _pad(of_failed, width, dimension)
        displacement = np.array([s.displacement for s in solved], dtype=np.float64)
        return {
            **body.shard_arrays(),
            "samples/number": np.array([s.number for s in solved], dtype=np.int64),
            "samples/loaded_nodes": loaded_nodes,
            "samples/force": force,
            "samples/displacement": displacement.reshape(-1, len(body.clamped), dimension),
            **{
                f"samples/{name}": np.array([getattr(s.report, of) for s in solved], dtype=kind)
                for name, of, kind in OF_REPORT
            },
            "samples/wall_time": np.array([s.wall_time for s in solved], dtype=np.float64),
            "failed/number": np.array([f.number for f in failed], dtype=np.int64),
            "failed/loaded_nodes": failed_nodes,
            "failed/force": failed_force,
            "failed/load_factor": np.array([f.report.load_factor for f in failed], float),
            "failed/reason": np.array([f.report.explanation for f in failed], dtype=object),
            **self._between("samples", of_solved),
            **self._between("failed", of_failed),
            **self._pressures(),
            **self._poses(),
        }

    def _recorded(self, result: Result) -> Recorded:
        """Forces that stand for the load of a sample."""
        load = result.load
        if result.grip is None:
            return load.nodes, load.forces, load.between
        pushes = 0.0 if result.contact is None else result.contact.force
        return self.body.loads.recorded(load, result.grip, pushes)

    def _between(self, group: str, loads: Sequence[Recorded]) -> dict[str, Any]:
        """Forces between the nodes, if a load of the case acts there."""
        points = self.body.loads.points
        if points is None or not self.body.loads.is_between:
            return {}
        values = np.zeros((len(loads), points.between, self.body.mesh.coordinates.shape[1]))
        for row, (_, _, between) in enumerate(loads):
            if between is not None:
                values[row] = between
        return {f"{group}/force_between": values}

    def _poses(self) -> dict[str, Any]:
        """Poses of the tool, if the case has one, and how deep a node is inside of it."""
        if not any(part.family.touches for part in self.body.loads.parts):
            return {}
        tools = [s.load.tool for s in self.solved]
        poses = [(*tool.begin, tool.radius) for tool in tools if tool is not None]
        depths = [s.contact.penetration for s in self.solved if s.contact is not None]
        width = self.body.mesh.coordinates.shape[1] + 1
        return {
            "samples/tool": np.array(poses, dtype=np.float64).reshape(-1, width),
            "samples/penetration": np.array(depths, dtype=np.float64),
        }

    def _pressures(self) -> dict[str, Any]:
        """Pressures of the samples, if the case has some."""
        count = len(self.body.loads.surfaces)
        return {
            f"{group}/pressure": np.array([r.load.pressures for r in some]).reshape(-1, count)
            for group, some in (("samples", self.solved), ("failed", self.failed))
            if count
        }


def merged(parts: Sequence[Arrays]) -> Arrays:
    """Merge the arrays of several parts of a shard, load cases in the order of their numbers.

    What a part does not hold, made by an earlier version, is known of none.
    """
    names = set.intersection(*(set(part) for part in parts))
    arrays = {name: values for name, values in parts[0].items() if name in names}
    for group in ("samples", "failed"):
        order = np.argsort(np.concatenate([part[f"{group}/number"] for part in parts]))
        for name in (name for name in arrays if name.startswith(f"{group}/")):
            arrays[name] = np.concatenate([part[name] for part in parts])[order]
    return arrays


def _pad(loads: Sequence[Recorded], width: int, dimension: int) -> tuple[Any, Any]:
    """Loaded nodes (n, width) and forces (n, width, d), padded."""
    nodes = np.full((len(loads), width), NO_NODE, dtype=np.int64)
    force = np.zeros((len(loads), width, dimension))
    for row, (loaded, forces, _) in enumerate(loads):
        nodes[row, : len(loaded)] = loaded
        force[row, : len(loaded)] = forces
    return nodes, force
