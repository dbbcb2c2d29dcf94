"""Loads whose forces are sought: a body that is held at places, or pushed by a tool."""

from __future__ import annotations

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.tools import Tool, parse_tool
from surrogate.touch.body import Body, LoadedBody
from surrogate.touch.grip import Grip, GripFrame, Held
from surrogate.touch.touch import Touch, TouchFrame

SINGLE = 1e-4  # tolerance of a contact that is no frame
HELD = 1e-5  # of grips that are no frame


def gripped(
    model: Body,
    held: Held,
    given: CommandLoads,
    nearest: bool,
    correct: bool,
    tolerance: float | None,
) -> GripFrame:
    """Find the forces of grips by predictions; then by what the solution shows, if that is more.

    Raises
    ------
    InputError, WorkError
        As `Grip` and `Grip.move`.
    """
    grip = Grip(model, held, nearest, tolerance=HELD)
    given.notes += grip.notes
    frame = grip.move(grip.displacements, given)
    if correct:
        return grip.correct(grip.displacements, given)
    if tolerance is None or frame.correction is not None:
        return frame
    return grip.move(
        grip.displacements, given, predict=LoadedBody.of(model, given).driven(tolerance)
    )


def pushed(
    model: Body,
    tool: str | Tool,
    given: CommandLoads,
    correct: bool,
    tolerance: float | None,
) -> TouchFrame:
    """Find the forces of a tool by predictions; then by what the solution shows, if that is more.

    A corrected state is the equilibrium of the finite elements and the tool together.

    Raises
    ------
    InputError, WorkError
        As `parse_tool` and `Touch.move`.
    """
    if isinstance(tool, str):
        tool = parse_tool(tool, model.geometry.dimension)
    touch = Touch(model, min(SINGLE, tolerance or SINGLE))
    frame = touch.move(tool, given)
    if correct:
        return touch.correct(tool, given)
    if tolerance is None or frame.correction is not None:
        return frame
    return touch.move(tool, given, predict=LoadedBody.of(model, given).driven(tolerance))
