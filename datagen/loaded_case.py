"""A case under the loads of a command: its body, with a problem that is built for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from datagen.cases.body import Body, make_body
from datagen.cases.case import Case
from datagen.cases.placed_body import points_of
from datagen.mesh.distributed_mesh import Mesh
from datagen.solver.tool_contact import ToolContact, touched
from shared_schema.actuators import Control, pressed
from shared_schema.common.bodies.command_loads import (
    CommandLoads,
    LoadedBody,
    Loads,
    command_loads,
)
from shared_schema.common.errors import InputError
from shared_schema.tools import Tool, parse_tool

Array = NDArray[np.float64]
MOST_FRICTION = 100.0


@dataclass(frozen=True)
class Pushing:
    """What is said of a tool.

    Attributes
    ----------
    tool : str, Tool or None
    friction : float
    comes_from : sequence of str or of d floats, or array (n, d)
        Displacements in m from its place.
    """

    tool: str | Tool | None
    friction: float
    comes_from: Sequence[str | Sequence[float]] | Array

    def on(self, body: Body) -> ToolContact | None:
        """Contact of the tool with a body; None without a tool."""
        tool, d = self.tool, body.mesh.coordinates.shape[1]
        if tool is None:
            if self.friction or len(self.comes_from):
                raise InputError("--friction and --tool-from: expected with --tool")
            return None
        if not 0 <= self.friction <= MOST_FRICTION:  # true for NaN as well
            raise InputError(
                f"--friction {self.friction:g}: expected a number from 0 to {MOST_FRICTION:g}"
            )
        way = [_displacement(each, d) for each in self.comes_from]
        form = tool if isinstance(tool, Tool) else parse_tool(tool, d)
        try:
            points = np.array(way).reshape(-1, d)
            return touched(body.problem, form, body.surface, self.friction, points)
        except InputError as error:
            raise InputError(f"--tool: {error}") from None


def _displacement(said: str | Sequence[float] | Array, d: int) -> Array:
    """One displacement of a tool, (d,)."""
    try:
        values = said.split(",") if isinstance(said, str) else said
        found = np.array([float(value) for value in values])
    except ValueError:
        found = np.empty(0)
    if found.shape != (d,) or not np.isfinite(found).all():
        raise InputError(f"--tool-from {said}: expected {d} finite numbers, separated by commas")
    return found


@dataclass(frozen=True)
class LoadedCase:
    """A body and what drives it.

    Attributes
    ----------
    body : Body
    given : CommandLoads
    actuation : tuple of Control
        What is given of each actuator.
    """

    body: Body
    given: CommandLoads
    actuation: tuple[Control, ...]

    @property
    def controls(self) -> tuple[Control, ...]:
        """What is given of each following load: pressures, then actuators."""
        return (*pressed(self.given.pressures), *self.actuation)

    @property
    def dead(self) -> tuple[NDArray[np.int64], Array]:
        """Loaded nodes, and their forces in N."""
        nodes = np.flatnonzero(self.given.forces.any(axis=1))
        return nodes, self.given.forces[nodes]


@contextmanager
def loaded_case(
    case: Case,
    comm: Any,
    load: Loads,
    forces: Sequence[Path | str],
    held: Sequence[str],
    actuate: Sequence[str],
    body_force: str | Sequence[float] | None,
    nearest: bool,
    parameters: Mapping[str, float],
    needed: bool,
) -> Iterator[LoadedCase]:
    """Build the problem of a case for the loads of a command; it is closed at the end (collective).

    Parameters are those of `datagen.solution.solve`; a load is `needed` if nothing else drives the
    body.
    """
    given: CommandLoads | None = None

    def driven(mesh: Mesh, supported: NDArray[np.bool_]) -> CommandLoads:
        nonlocal given
        known = mesh.coordinates, mesh.cells, mesh.cell_type
        body = LoadedBody(*known, supported, mesh.node_sets, points_of(case, mesh), mesh.parts)
        files = [Path(path) for path in forces]
        given = command_loads(body, load, files, held, nearest, body_force, needed)
        return given

    body = make_body(case, MPI.COMM_SELF if comm is None else comm, driven, parameters)
    assert given is not None
    try:
        yield LoadedCase(body, given, body.loads.actuators.given(actuate))
    finally:
        body.problem.close()
