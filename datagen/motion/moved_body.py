"""The motion of one body: solved, kept, and written to a file."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.cases.case import Case, CaseSource, read_case
from datagen.loaded_case import LoadedCase, Pushing, loaded_case
from datagen.motion.trajectory import Drive, Trajectory, begin_motion, end_motion, frames_of
from datagen.output.paraview_series import SUFFIXES, in_motion, write_series
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.command_loads import Loads
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import complete_or_absent
from shared_schema.common.machine import require_memory
from shared_schema.common.progress import Progress
from shared_schema.common.solution_file import require_suffix
from shared_schema.common.units import SI, Units
from shared_schema.materials import Volumetric
from shared_schema.motion import TimeSettings, densities_of_cells, read_history
from shared_schema.tools import Tool

Array = NDArray[np.float64]
FORMATS = (".npz", *SUFFIXES)
BYTES = 64  # of a node in a frame, in memory and in a file


@dataclass(frozen=True, repr=False, kw_only=True)
class MovedBody:
    """Motion of a body under one load case.

    Attributes
    ----------
    case : str
        Name of the case.
    coordinates : array, (n_nodes, d)
        In m.
    cells : array of int, (n_cells, n_corners)
        Node numbers, VTK order.
    cell_type : str
        meshio's name.
    trajectory : Trajectory
        Frames as arrays: displacement, velocity, energies.
    settings : TimeSettings
    unknowns : int
        Number of unknowns.
    seconds : float
        Time of the solve.
    notes : tuple of str
        Which nodes loads were moved to (`nearest`).
    units : Units
    """

    case: str
    coordinates: Array
    cells: NDArray[np.int64]
    cell_type: str
    trajectory: Trajectory
    settings: TimeSettings
    unknowns: int
    seconds: float
    notes: tuple[str, ...]
    units: Units = SI

    @property
    def largest_displacement(self) -> float:
        """Largest displacement of a node in all frames in m."""
        return float(np.linalg.norm(self.trajectory.displacement, axis=2).max())

    def __repr__(self) -> str:
        """Say how long the body moved, and how far."""
        return (
            f"<MovedBody of {self.case}: {len(self.trajectory.times)} frames to "
            f"{self.trajectory.times[-1]:.6g} s, largest displacement "
            f"{self.largest_displacement:.6g} {self.units.length}>"
        )

    @checked_arguments
    def save(self, path: Path | str) -> None:
        """Write the frames: ``.npz``, or a series for ParaView, ``.xdmf`` or ``.pvd``.

        Raises
        ------
        InputError
            If the file name has another ending, or there is no such folder.
        """
        found, moved = Path(path), self.trajectory
        require_suffix(found, FORMATS)
        if found.suffix == ".npz":
            arrays = {"coordinates": self.coordinates, "cells": self.cells, **vars(moved)}
            with complete_or_absent(found) as partial, partial.open("wb") as file:
                np.savez(file, **arrays)
            return
        frames = zip(moved.times.tolist(), moved.displacement, moved.velocity, strict=True)
        mesh = self.coordinates, self.cells, self.cell_type
        write_series(found, mesh, (in_motion(*frame) for frame in frames))


@checked_arguments
def move(
    case: CaseSource,
    load: Loads = (),
    *,
    duration: float | None = None,
    step: float | None = None,
    history: str | None = None,
    forces: Sequence[Path | str] = (),
    held: Sequence[str] = (),
    tool: str | Tool | None = None,
    friction: float = 0.0,
    tool_from: Sequence[str | Sequence[float]] | Array = (),
    actuate: Sequence[str] = (),
    body_force: str | Sequence[float] | None = None,
    nearest: bool = False,
    volumetric: Volumetric | None = None,
    changes: Sequence[str] = (),
    parameters: Mapping[str, float] = MappingProxyType({}),
    trust: bool = False,
    comm: Any = None,
) -> MovedBody:
    """Let a body move under one load case; ranks that call it share it as those of `solve` do.

    Parameters
    ----------
    case : CaseSource
        Its materials have a density.
    duration, step : float, optional
        In s; by default those of the case's key ``time``, as all other settings of it.
    history : str, optional
        Factor of all that drives the body over time: ``held``, ``let_go``, ``ramp=SECONDS`` or
        ``random=HERTZ`` (`shared_schema.motion.histories`).
    load, forces, held, tool, friction, tool_from, actuate, body_force, nearest
        As for `datagen.solve`.
    volumetric, changes, parameters, trust, comm
        As for `datagen.solve`.

    Raises
    ------
    InputError
        If the case, the load or a setting is wrong, or a material has no density.
    WorkError
        If a step has no solution.
    """
    found = read_case(case, volumetric=volumetric, trust=trust, changes=changes)
    settings = _settings(found, duration, step, history)
    loads = load, forces, held, actuate, body_force, nearest, parameters
    needed = tool is None and not actuate
    with loaded_case(found, comm, *loads, needed=needed) as loaded:
        return _moved(loaded, settings, Pushing(tool, friction, tool_from))


def _settings(
    case: Case, duration: float | None, step: float | None, history: str | None
) -> TimeSettings:
    """Settings of the case with those that are given."""
    content: dict[str, Any] = {} if case.time is None else case.time.model_dump()
    given = {"duration": duration, "step": step}
    content |= {key: value for key, value in given.items() if value is not None}
    if history is not None:
        content["load"] = read_history(history)
    for key in given:
        if key not in content:
            raise InputError(f"--{key}: missing, expected seconds, or key 'time' of the case")
    try:
        densities_of_cells(case.material, None, 0)
    except InputError as error:
        raise InputError(f"case '{case.name}': {error}") from None
    return validate(TimeSettings, content, "--duration and --step")


def _moved(loaded: LoadedCase, settings: TimeSettings, pushing: Pushing) -> MovedBody:
    """Take all steps, and collect the frames."""
    body, given, problem = loaded.body, loaded.given, loaded.body.problem
    size = BYTES * body.mesh.coordinates.size * len(settings.frames)
    require_memory(size, f"{len(settings.frames)} frames (key 'time.every')")
    drive = Drive(
        *loaded.dead,
        controls=loaded.controls,
        displacement=given.displacement,
        between=given.forces_between,
        touch=lambda: pushing.on(body),
    )
    title = f"datagen solve {body.case.name}"
    progress = Progress(settings.steps, 0, "steps", title, problem.comm.rank > 0, passing=True)
    began, motion = time.perf_counter(), None
    try:
        motion = begin_motion(body, settings, settings.load_over_time(), drive)
        frames = list(frames_of(motion, settings, lambda now: progress.update(now.number)))
    finally:
        progress.close()
        end_motion(body, motion)
    return MovedBody(
        case=body.case.name,
        coordinates=body.mesh.coordinates,
        cells=body.mesh.cells,
        cell_type=body.mesh.cell_type,
        trajectory=Trajectory.of(frames),
        settings=settings,
        unknowns=problem.size,
        seconds=time.perf_counter() - began,
        notes=tuple(given.notes),
        units=body.case.units,
    )
