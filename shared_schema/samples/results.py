"""Results of load cases, and the arrays of a nodal shard that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.shape_family import ShapeFamily
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.loads import Load, LoadsTogether, Recorded
from shared_schema.tools import Contact

OF_REPORT = (  # datasets below ``samples/``, with attributes and types of a report
    ("converged_reason", "reason", np.int64),
    ("load_steps", "load_steps", np.int64),
    ("cutbacks", "cutbacks", np.int64),
    ("newton_iterations", "newton_iterations", np.int64),
    ("residual_norm", "residual_norm", np.float64),
    ("stable", "stable", np.bool_),
)


@dataclass(frozen=True)
class SolveReport:
    """Outcome of one load case.

    Attributes
    ----------
    solved : bool
    reason : int
        PETSc's SNESConvergedReason of the last Newton solve, or what it would be.
    explanation : str
        The reason in words.
    load_factor : float
        Load factor s of the last equilibrium: 1 if solved.
    load_steps : int
        Number of load steps that converged.
    cutbacks : int
        Number of load steps that failed and were cut back.
    newton_iterations : int
        Number of Newton iterations over all steps, failed ones included.
    residual_norm : float
        2-norm of the residual of the last Newton solve, in N.
    stable : bool
        False if the equilibrium is unstable (`datagen.stability`), which is found out afterwards.
    left : bool
        True if an unstable equilibrium was left for this one.
    """

    solved: bool
    reason: int
    explanation: str
    load_factor: float
    load_steps: int
    cutbacks: int
    newton_iterations: int
    residual_norm: float
    stable: bool = True
    left: bool = False


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
    actuated : array, (n_actuators, 2), or None
        Pressure or tension of each actuator, and its volume or length.
    frames : tuple of arrays, or None
        Of a motion: factors, displacements in m and velocities in m/s.
    """

    number: int
    load: Load
    grip: NDArray[np.float64] | None
    contact: Contact | None
    displacement: NDArray[np.float64]
    report: SolveReport
    wall_time: float
    actuated: NDArray[np.float64] | None = None
    frames: tuple[NDArray[np.float64], ...] | None = None


def not_begun(number: int, load: Load, reason: str) -> Result:
    """Record a load case of a body that cannot be solved."""
    report = SolveReport(False, 0, reason, 0.0, 0, 0, 0, 0.0)
    return Result(number, load, None, None, np.empty(0), report, 0.0)


def result_arrays(
    loads: LoadsTogether,
    results: Sequence[Result],
    shapes: ShapeFamily | None = None,
    times: NDArray[np.float64] | None = None,
) -> dict[str, Any]:
    """Results as arrays, by their paths in the schema of a nodal shard, without those of the mesh.

    Parameters
    ----------
    loads : LoadsTogether
        The load cases of the dataset.
    results : sequence of Result
    shapes : ShapeFamily, optional
        Shapes of which every sample has its own.
    times : array, (n_frames,), optional
        Times in s of the frames of motions.
    """
    nodes, dimension = loads.held.shape
    every = sorted(results, key=lambda result: result.number)
    solved = [result for result in every if result.report.solved]
    failed = [result for result in every if not result.report.solved]
    of_solved, of_failed = (
        [_recorded(loads, r, shapes) for r in some] for some in (solved, failed)
    )
    loaded_nodes, force = _pad(of_solved, loads.most, dimension)
    failed_nodes, failed_force = _pad(of_failed, loads.most, dimension)
    displacement = np.array([s.displacement for s in solved], dtype=np.float64)
    return {
        "samples/number": np.array([s.number for s in solved], dtype=np.int64),
        "samples/loaded_nodes": loaded_nodes,
        "samples/force": force,
        "samples/displacement": displacement.reshape(-1, nodes, dimension),
        **{
            f"samples/{name}": np.array([getattr(s.report, of) for s in solved], dtype=kind)
            for name, of, kind in OF_REPORT
            if times is None or name != "stable"
        },
        "samples/wall_time": np.array([s.wall_time for s in solved], dtype=np.float64),
        "failed/number": np.array([f.number for f in failed], dtype=np.int64),
        "failed/loaded_nodes": failed_nodes,
        "failed/force": failed_force,
        "failed/load_factor": np.array([f.report.load_factor for f in failed], float),
        "failed/reason": np.array([f.report.explanation for f in failed], dtype=object),
        **_between(loads, "samples", of_solved),
        **_between(loads, "failed", of_failed),
        **_pressures(loads, solved, failed),
        **_poses(loads, solved),
        **({} if shapes is None else _shapes(loads, solved, failed, shapes)),
        **_actuation(loads, solved, failed),
        **({} if times is None else _frames(solved, times, loads.held.shape)),
    }


def _recorded(loads: LoadsTogether, result: Result, shapes: ShapeFamily | None) -> Recorded:
    """Forces that stand for the load of a sample."""
    load = result.load
    if result.grip is None:
        return load.nodes, load.forces, load.between
    if shapes is not None:
        loads = loads.on(shapes.coordinates(shapes.drawn(loads.seed, result.number)))
    pushes = 0.0 if result.contact is None else result.contact.force
    amplitudes = None if result.actuated is None else result.actuated[:, 0]
    return loads.recorded(load, result.grip, pushes, amplitudes)


def _between(loads: LoadsTogether, group: str, recorded: Sequence[Recorded]) -> dict[str, Any]:
    """Forces between the nodes, if a load of the case acts there."""
    points = loads.points
    if points is None or not loads.is_between:
        return {}
    values = np.zeros((len(recorded), points.between, loads.held.shape[1]))
    for row, (_, _, between) in enumerate(recorded):
        if between is not None:
            values[row] = between
    return {f"{group}/force_between": values}


def _poses(loads: LoadsTogether, solved: Sequence[Result]) -> dict[str, Any]:
    """Poses of the tool, if the case has one, and how deep a node is inside of it."""
    if not any(part.family.touches for part in loads.parts):
        return {}
    tools = [s.load.tool for s in solved]
    poses = [(*tool.begin, tool.radius) for tool in tools if tool is not None]
    depths = [s.contact.penetration for s in solved if s.contact is not None]
    width = loads.held.shape[1] + 1
    return {
        "samples/tool": np.array(poses, dtype=np.float64).reshape(-1, width),
        "samples/penetration": np.array(depths, dtype=np.float64),
    }


def _pressures(
    loads: LoadsTogether, solved: Sequence[Result], failed: Sequence[Result]
) -> dict[str, Any]:
    """Pressures of the samples, if the case has some."""
    count = len(loads.surfaces)
    return {
        f"{group}/pressure": np.array([r.load.pressures for r in some]).reshape(-1, count)
        for group, some in (("samples", solved), ("failed", failed))
        if count
    }


def _shapes(
    loads: LoadsTogether, solved: Sequence[Result], failed: Sequence[Result], shapes: ShapeFamily
) -> dict[str, Any]:
    """Parameters of the load cases, and node positions of the samples."""
    count = len(shapes.names)
    of_solved, of_failed = (
        np.array([shapes.drawn(loads.seed, r.number) for r in some]).reshape(-1, count)
        for some in (solved, failed)
    )
    positions = np.array([shapes.coordinates(values) for values in of_solved])
    return {
        "samples/parameters": of_solved,
        "samples/coordinates": positions.reshape(-1, *loads.held.shape),
        "failed/parameters": of_failed,
    }


def _actuation(
    loads: LoadsTogether, solved: Sequence[Result], failed: Sequence[Result]
) -> dict[str, Any]:
    """What is given and found of the actuators, if the case has some."""
    count = len(loads.actuators)
    if not count:
        return {}
    given = {
        f"{group}/actuation": np.array(
            [[control.value for control in r.load.actuation] for r in some]
        ).reshape(-1, count)
        for group, some in (("samples", solved), ("failed", failed))
    }
    found = np.array([r.actuated for r in solved], dtype=np.float64).reshape(-1, count, 2)
    return given | {
        "samples/amplitude": found[:, :, 0],
        "samples/quantity": found[:, :, 1],
    }


def _frames(
    solved: Sequence[Result], times: NDArray[np.float64], shape: tuple[int, ...]
) -> dict[str, Any]:
    """Frames of the samples, which are motions."""
    moved = [result.frames for result in solved if result.frames is not None]
    factor, displacement, velocity = (np.array([each[i] for each in moved]) for i in range(3))
    whole = (len(moved), len(times), *shape)
    return {
        "frames/time": times,
        "samples/frame_factor": factor.reshape(whole[:2]),
        "samples/frame_displacement": displacement.reshape(whole),
        "samples/frame_velocity": velocity.reshape(whole),
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
