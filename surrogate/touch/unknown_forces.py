"""Loads whose forces are sought: a body that is held at places, or pushed by a tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.errors import InputError
from shared_schema.tools import Tool, parse_tool
from surrogate.touch.body import Body, Predict
from surrogate.touch.grip import Grip, GripFrame, Held
from surrogate.touch.touch import Touch, TouchFrame

Array = NDArray[np.float64]
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
        As `Grip` and `Grip.move`; InputError if a pressure acts.
    """
    require_dead("held", given)
    grip = Grip(model, held, nearest, tolerance=HELD)
    given.notes += grip.notes
    load, frame = given.load, grip.move(grip.displacements, given.load)
    if correct:
        return grip.correct(grip.displacements, load)
    shown = what_is_shown(model, tolerance)
    if shown is None or frame.correction is not None:
        return frame
    return grip.move(grip.displacements, load, predict=shown)


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
        As `parse_tool` and `Touch.move`; InputError if a pressure acts.
    """
    require_dead("tool", given)
    if isinstance(tool, str):
        tool = parse_tool(tool, model.geometry.dimension)
    touch = Touch(model, min(SINGLE, tolerance or SINGLE))
    load, frame = given.load, touch.move(tool, given.load)
    if correct:
        return touch.correct(tool, load)
    shown = what_is_shown(model, tolerance)
    if shown is None or frame.correction is not None:
        return frame
    return touch.move(tool, load, predict=shown)


def what_is_shown(model: Body, tolerance: float | None) -> Predict | None:
    """What goes from forces in N to the displacements in m of a solution; None for predictions."""
    if tolerance is None:
        return None
    pressure = model.geometry.no_pressure
    return lambda force: np.asarray(model.predict(force, tolerance=tolerance, pressure=pressure))


def require_dead(name: str, given: CommandLoads) -> None:
    """Raise InputError if a pressure acts."""
    if given.surfaces:
        raise InputError(f"{name}: expected forces beside it, no pressure")
