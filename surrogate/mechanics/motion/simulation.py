"""A motion as a script tells it: phases of loads, tools and grips, and what is recorded of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shared_schema.common.bodies.command_loads import command_loads
from shared_schema.common.configuration import Frozen, read_yaml, validate
from shared_schema.common.errors import InputError
from shared_schema.common.files import complete_or_absent
from shared_schema.common.solution_file import write_solution
from shared_schema.motion import LoadOverTime
from shared_schema.motion.histories import Duration
from shared_schema.tools import parse_tool
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.motion.frame import Frame
from surrogate.mechanics.motion.session import Session
from surrogate.mechanics.statics.load import Load

Array = NDArray[np.float64]
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
WHOLE = 1e-9  # of a step, that a phase may be longer than whole steps


class Phase(Frozen):
    """A part of a motion.

    Attributes
    ----------
    seconds : float
        How long it takes, in s; the last step ends there or beyond.
    load : tuple of str
        Texts of ``--load``.
    tool : str or None
        Text of ``--tool``.
    held : tuple of str
        Texts of ``--hold``.
    actuate : tuple of str
        NAME=VALUE of actuators, tensions in N and pressures in Pa.
    moving : bool
        The numbers of these texts go in equal steps from those of the phase before, of which there
        must be as many, to those here.
    """

    seconds: Duration
    load: tuple[str, ...] = ()
    tool: str | None = None
    held: tuple[str, ...] = ()
    actuate: tuple[str, ...] = ()
    moving: bool = False

    def on_the_way(self, before: Phase, share: float) -> Phase:
        """What acts at a part of the way from the phase before."""
        pairs = {
            name: (getattr(before, name), getattr(self, name))
            for name in ("load", "held", "actuate")
        }
        found = {name: _between(*both, share) for name, both in pairs.items()}
        tools = [() if each.tool is None else (each.tool,) for each in (before, self)]
        tool = next(iter(_between(tools[0], tools[1], share)), None)
        return self.model_copy(update={**found, "tool": tool})


class Script(Frozen):
    """A motion in phases.

    Attributes
    ----------
    step : float
        Time step h in s.
    phases : tuple of Phase
    """

    step: Duration
    phases: tuple[Phase, ...] = Field(min_length=1)

    @classmethod
    def read(cls, path: Path) -> Script:
        """Read a YAML file; InputError if it is damaged, or a phase cannot follow the last one."""
        found = validate(cls, read_yaml(path), str(path))
        for before, phase in zip((Phase(seconds=1), *found.phases), found.phases, strict=False):
            if phase.moving:
                phase.on_the_way(before, 0.5)
        return found

    def frames(self, session: Session, certify: bool = False) -> Iterator[Frame]:
        """Yield the frames of all steps."""
        before, d = Phase(seconds=1), session.body.geometry.dimension
        for phase in self.phases:
            count = steps_of(phase.seconds, self.step)
            for number in range(1, count + 1):
                now = phase.on_the_way(before, number / count) if phase.moving else phase
                yield session.step(
                    self.step,
                    command_loads(session.body.geometry.loaded_body, now.load, needed=False),
                    tool=None if now.tool is None else parse_tool(now.tool, d),
                    held=now.held or None,
                    actuation=now.actuate,
                    certify=certify,
                )
            before = phase


def steps_of(seconds: float, step: float) -> int:
    """Number of steps that take so many seconds, 1 at least."""
    return max(1, int(np.ceil(seconds / step - WHOLE)))


def under_load(
    session: Session, load: Load, over_time: LoadOverTime, step: float, seconds: float
) -> Iterator[Frame]:
    """Yield the frames of a body under one load over time."""
    session.begin(
        load if over_time.begins_loaded else None, acting=load.part(over_time.factor(0.0))
    )
    for number in range(1, steps_of(seconds, step) + 1):
        yield session.step(step, load.part(over_time.factor(number * step)))


def _between(before: Sequence[str], after: Sequence[str], share: float) -> tuple[str, ...]:
    """Texts whose numbers are a part of the way from some to others."""
    found = []
    for number, text in enumerate(after):
        other = before[number] if number < len(before) else ""
        ends = [[float(each) for each in NUMBER.findall(part)] for part in (other, text)]
        if len(before) != len(after) or NUMBER.sub("#", other) != NUMBER.sub("#", text):
            raise InputError(
                f"moving: '{text}': expected the same with other numbers in the phase before"
            )
        words = [*NUMBER.split(text)]
        for place, (a, b) in enumerate(zip(*ends, strict=True)):
            words[place] += repr((1 - share) * a + share * b)
        found.append("".join(words))
    return tuple(found)


@dataclass(frozen=True)
class Recording:
    """Frames of a body, one after the other.

    Attributes
    ----------
    geometry : Geometry
    times, errors : array, (n_frames,)
        In s, and the estimated error in m that each step adds.
    displacement, velocity, force : array, (n_frames, n_nodes, d)
        In m, in m/s, and of a tool in N.
    energies : array, (n_frames, 5)
        kinetic, strain, work, dissipated and drift in J.
    directions : array of int, (n_frames,)
    """

    geometry: Geometry
    times: Array
    errors: Array
    displacement: Array
    velocity: Array
    force: Array
    energies: Array
    directions: NDArray[np.int64]

    @classmethod
    def of(cls, geometry: Geometry, frames: Iterator[Frame]) -> Recording:
        """Take frames as they come."""
        rows = [
            (f.time, f.error, f.displacement, f.velocity, f.force, energies(f), f.directions)
            for f in frames
        ]
        return cls(geometry, *(np.array(column) for column in zip(*rows, strict=True)))

    def save(self, path: Path) -> None:
        """Write .npz, or .pvd with a .vtu of every frame, for ParaView."""
        if path.suffix == ".npz":
            fields: dict[str, Any] = {k: v for k, v in vars(self).items() if k != "geometry"}
            mesh: dict[str, Any] = {
                "coordinates": self.geometry.coordinates,
                "cells": self.geometry.cells,
            }
            with complete_or_absent(path) as partial, partial.open("wb") as file:
                np.savez(file, **mesh, **fields)
            return
        body, lines = self.geometry, []
        for number, time in enumerate(self.times):
            of_time = path.with_name(f"{path.stem}-{number:05d}.vtu")
            both = {"displacement": self.displacement, "velocity": self.velocity}
            of_frame = {name: values[number] for name, values in both.items()}
            write_solution(of_time, body.coordinates, body.cells, body.cell_type, of_frame)
            lines.append(f'<DataSet timestep="{time!r}" file="{of_time.name}"/>')
        text = "".join(lines)
        with complete_or_absent(path) as partial:
            partial.write_text(
                f'<VTKFile type="Collection"><Collection>{text}</Collection></VTKFile>'
            )


def energies(frame: Frame) -> list[float]:
    """Energies of a frame in J, in the order of `Recording`."""
    return list(vars(frame.energies).values())
