"""The motion of a body under one load case, from its begin to its last frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from datagen.cases.body import Body
from datagen.motion.time_stepping import Frame, Motion, MotionError, inertia_of
from datagen.solver.equilibrium import EquilibriumProblem
from datagen.solver.load_stepping import solve_load_case
from datagen.solver.tool_contact import ToolContact
from datagen.stability import with_stability
from shared_schema.actuators import Control
from shared_schema.common.bodies.following_loads import FollowingLoad
from shared_schema.common.errors import InputError
from shared_schema.motion import LoadOverTime, TimeSettings

Array = NDArray[np.float64]
NOTHING = np.empty(0, dtype=np.int64)
WITHIN = 0.5  # of the body's smallest extent: largest way of a tool within one step


@dataclass(frozen=True)
class Drive:
    """A load case, as `EquilibriumProblem.set_load` takes it, and the tool.

    Attributes
    ----------
    nodes, forces, controls, displacement, between
        As there.
    touch : callable
        Puts the tool where it shall be; None without one.
    """

    nodes: NDArray[np.int64]
    forces: Array
    controls: Sequence[Control] = ()
    displacement: Array | None = None
    between: Array | None = None
    touch: Callable[[], ToolContact | None] = lambda: None


def begin_motion(
    body: Body, settings: TimeSettings, over_time: LoadOverTime, drive: Drive
) -> Motion:
    """Bring a body to the begin of its motion (collective).

    Its problem is in motion until `end_motion`.

    Parameters
    ----------
    body : Body
    settings : TimeSettings
    over_time : LoadOverTime
        Factor of the load.
    drive : Drive

    Raises
    ------
    InputError
        If a material has no density, the scheme does not know elements or forces, or a tool could
        jump through the body.
    MotionError
        If there is no equilibrium from which the body could be let go.
    """
    problem, case = body.problem, body.case
    known = case.material, body.parts, settings
    problem.reset()
    problem.load.contact = drive.touch()
    given = drive.controls, drive.displacement
    if over_time.begins_loaded:
        acting = problem, drive.nodes, drive.forces, case.solver
        report = with_stability(
            problem, solve_load_case(*acting, *given, between=drive.between), case.solver
        )
        if not report.solved:
            raise MotionError(f"no equilibrium to let the body go from ({report.explanation})")
        problem.load.contact = None
        if problem.supports.has_grip:
            problem = _released(body)
        problem.set_load(NOTHING, np.empty((0, problem.dimension)))
    else:
        problem.set_load(drive.nodes, drive.forces, *given, between=drive.between)
        _require_slow(problem, settings, over_time)
    return Motion(problem, settings, inertia_of(problem, *known), over_time)


def frames_of(
    motion: Motion, settings: TimeSettings, pause: Callable[[Motion], None] = lambda motion: None
) -> Iterator[Frame]:
    """Take all steps, and yield the frames (collective).

    Parameters
    ----------
    motion : Motion
        At its begin, or where it was left.
    settings : TimeSettings
    pause : callable
        Called after each step.

    Raises
    ------
    MotionError
        If a step has no solution.
    """
    wanted = set(settings.frames)
    if motion.number == 0:
        yield motion.frame()
    while motion.number < settings.steps:
        motion.step()
        if motion.number in wanted:
            yield motion.frame()
        pause(motion)


def end_motion(body: Body, motion: Motion | None) -> None:
    """Let the body of a problem be without inertia again."""
    body.problem.load.contact = None
    body.problem.move(None)
    if motion is not None and motion.problem is not body.problem:
        motion.problem.close()


def _released(body: Body) -> EquilibriumProblem:
    """Problem of the body in its present state without its grips."""
    case, held = body.case, body.problem
    known = body.mesh, case.material, body.held, case.solver, case.element, body.parts
    following: Sequence[FollowingLoad]
    following = () if held.load.following is None else held.load.following.loads
    problem = EquilibriumProblem(*known, following=following, fibres=body.fibres)
    problem.meanwhile = held.meanwhile
    problem.restore(held.state())
    return problem


def _require_slow(
    problem: EquilibriumProblem, settings: TimeSettings, over_time: LoadOverTime
) -> None:
    """Raise InputError if the tool goes far within one step."""
    contact = problem.load.contact
    if contact is None:
        return
    times = settings.step * np.arange(settings.steps + 1)
    factors = np.array([0.0, *map(over_time.factor, times)])
    furthest = float(np.abs(np.diff(factors)).max()) * contact.way_length
    most = WITHIN * float(np.ptp(problem.mesh.coordinates, axis=0).min())
    if furthest > most:
        raise InputError(
            f"the tool moves {furthest:.3g} m within one step of {settings.step:g} s and may jump "
            f"through the body, expected at most {most:.3g} m: a load that is a ramp, or a shorter "
            "step"
        )


@dataclass(frozen=True)
class Trajectory:
    """Frames of a body in motion as arrays.

    Attributes
    ----------
    times, factors : array, (n_frames,)
        In s, and of the load.
    displacement, velocity : array, (n_frames, n_nodes, d)
        In m and m/s.
    energies : array, (n_frames, 4)
        Kinetic and strain energy, work and what is dissipated, in J.
    """

    times: Array
    factors: Array
    displacement: Array
    velocity: Array
    energies: Array

    @classmethod
    def of(cls, frames: Sequence[Frame]) -> Trajectory:
        """Stack frames."""
        energies = [(f.energies.kinetic, f.energies.strain, f.energies.work) for f in frames]
        lost = [[f.energies.dissipated] for f in frames]
        return cls(
            np.array([f.time for f in frames]),
            np.array([f.factor for f in frames]),
            np.array([f.displacement for f in frames]),
            np.array([f.velocity for f in frames]),
            np.concatenate([energies, lost], axis=1),
        )
