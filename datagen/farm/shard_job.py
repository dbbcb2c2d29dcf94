"""Load cases of one shard, solved one after the other: equilibria, or motions.

A motion keeps what it has every `KEEP` steps, beside the parts of the shard, and goes on from there
after an interruption, to the same frames.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from datagen.cases.body import Body
from datagen.cases.case import Case
from datagen.motion.time_stepping import Motion, MotionError
from datagen.motion.trajectory import Drive, begin_motion, end_motion
from datagen.ranks import on_rank_zero
from datagen.solver.following_loads import found_actuation
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.tool_contact import INSIDE, ToolContact, touched
from datagen.stability import with_stability
from shared_schema.common.bodies.equilibrium import size_warning
from shared_schema.common.errors import InputError, StoppedError
from shared_schema.common.files import complete_or_absent
from shared_schema.loads import Load
from shared_schema.motion import TimeSettings
from shared_schema.samples.results import Result, SolveReport, not_begun, result_arrays
from shared_schema.tools import Contact, Sphere

KEEP = 50
NAMES = "factor", "displacement", "velocity"


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
    folder : Path
        Where motions keep what they have.
    stopped : callable
        Says whether the work is to be left; collective.
    results : list of Result
        Of the load cases so far.
    """

    case: Case
    body: Body
    numbers: Sequence[int]
    folder: Path
    stopped: Callable[[], bool] = lambda: False
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
        StoppedError
            If a motion was left.
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
        if case.time is not None:
            return self._move(body, load, case.time)
        problem.load.contact = self._put(body, load.tool)
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

    def _move(self, body: Body, load: Load, settings: TimeSettings) -> bool:
        """Take all steps of the next load case on a body (collective)."""
        case, number, began = self.case, self.number, time.perf_counter()
        over_time = settings.load_over_time(case.dataset.seed, number)
        drive = Drive(
            *(load.nodes, load.forces, load.controls, load.displacement, load.between),
            touch=lambda: self._put(body, load.tool),
        )
        kept = _Kept(self.folder, number, body, settings)
        motion, said, contact, actuated = None, "", None, None
        try:
            motion = begin_motion(body, settings, over_time, drive)
            kept.resume(motion)
            while motion.number < settings.steps:
                motion.step()
                kept.take(motion)
                if motion.number % KEEP == 0 and self.stopped():
                    raise StoppedError
            contact = None if load.tool is None else _touch(motion)
            actuated = found_actuation(motion.problem, len(load.actuation))
        except MotionError as error:
            said = str(error)
        finally:
            end_motion(body, motion)
        reached = 0.0 if motion is None else motion.number / settings.steps
        last = None if motion is None else motion.last
        report = SolveReport(
            solved=not said,
            reason=0 if last is None else last.reason,
            explanation=said,
            load_factor=reached if said else 1.0,
            load_steps=0 if motion is None else motion.number,
            cutbacks=0 if motion is None else motion.halvings,
            newton_iterations=0 if motion is None else motion.iterations,
            residual_norm=0.0 if last is None else last.residual_norm,
        )
        elapsed = time.perf_counter() - began
        if said:
            failed = Result(number, load, None, None, np.empty(0), report, elapsed)
            self.results.append(failed)
            return False
        grip = None if load.is_dead else np.zeros(body.loads.positions.shape)
        whole = kept.displacement[-1], report, elapsed, actuated, kept.frames
        self.results.append(Result(number, load, grip, contact, *whole))
        return True

    def forget(self) -> None:
        """Remove what is kept of motions whose frames are in a shard, or in a part of one."""
        for result in self.results:
            for path in self.folder.glob(f"motion-{result.number:08d}-*"):
                path.unlink(missing_ok=True)

    def _put(self, body: Body, tool: Sphere | None) -> ToolContact | None:
        """Contact of the tool where it shall be, if there is one (collective)."""
        problem = body.problem
        problem.load.contact = None
        if tool is None:
            return None
        problem.reset()
        try:
            return touched(problem, tool, body.surface)
        except InputError as error:
            raise InputError(f"sample {self.number}: {error}") from None

    def size_warning(self) -> str | None:
        """What is unusual about the size of the displacements so far, if anything is."""
        displacement = np.array([result.displacement for result in self.solved])
        what = f"the largest displacement of the first {len(displacement)} samples"
        return size_warning(displacement, self.body.mesh.coordinates, what)

    def arrays(self) -> dict[str, Any]:
        """Results so far as arrays, by their paths in the schema of a nodal shard."""
        settings = self.case.time
        times = None if settings is None else settings.step * np.array(settings.frames)
        return self.body.shard_arrays() | result_arrays(
            self.body.loads, self.results, self.body.mesh.shapes, times
        )


def _touch(motion: Motion) -> Contact:
    """What the tool does at the end; nothing if it is gone."""
    problem, displacement = motion.problem, motion.problem.displacement()
    if problem.load.contact is None:
        return Contact(np.zeros_like(displacement), 0.0)
    return problem.load.contact.found(displacement, problem.load_factor)


class _Kept:
    """Frames of a motion so far, and the file of a rank from which it goes on.

    Parameters
    ----------
    folder : Path
    number : int
        Of the sample.
    body : Body
    settings : TimeSettings

    Attributes
    ----------
    factor, displacement, velocity : list of float, or of array (n_nodes, d)
        Of every frame.
    """

    def __init__(self, folder: Path, number: int, body: Body, settings: TimeSettings) -> None:
        self._comm, self._wanted = body.mesh.domain.comm, set(settings.frames)
        rank = f"{self._comm.rank}-of-{self._comm.size}"
        self._path = folder / f"motion-{number:08d}-{rank}.npz"
        self._last = settings.steps
        self.factor: list[Any] = []
        self.displacement: list[Any] = []
        self.velocity: list[Any] = []

    @property
    def frames(self) -> tuple[Any, ...]:
        """Factors, displacements and velocities."""
        return tuple(map(np.array, (self.factor, self.displacement, self.velocity)))

    def resume(self, motion: Motion) -> None:
        """Go on from the file, if all ranks have one of the same step; else from the begin."""
        found = self._read()
        steps = self._comm.allgather(-1 if found is None else int(found["numbers"][0]))
        if found is None or min(steps) < 0 or len(set(steps)) > 1:
            self._add(motion)
            return
        motion.restore(found)
        for name in NAMES:
            setattr(self, name, list(found[name]))

    def take(self, motion: Motion) -> None:
        """Take a frame after a step, and write the file at times (collective)."""
        if motion.number in self._wanted:
            self._add(motion)
        if motion.number % KEEP and motion.number != self._last:
            return
        arrays = {**motion.state(), **dict(zip(NAMES, self.frames, strict=True))}
        self._path.parent.mkdir(exist_ok=True)
        with complete_or_absent(self._path) as partial, partial.open("wb") as file:
            np.savez(file, **arrays)

    def _add(self, motion: Motion) -> None:
        frame = motion.frame()
        for name in NAMES:
            getattr(self, name).append(getattr(frame, name))

    def _read(self) -> dict[str, Any] | None:
        try:
            with np.load(self._path) as arrays:
                return dict(arrays)
        except (OSError, ValueError, BadZipFile):
            return None
