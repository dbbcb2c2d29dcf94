"""Loads whose forces are sought: a body that is held at places, or pushed by a tool."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.tools import Tool, parse_tool
from surrogate.mechanics.statics.prediction import Predictor
from surrogate.mechanics.touch.grip import Grip, GripFrame, Held
from surrogate.mechanics.touch.loaded_body import LoadedBody
from surrogate.mechanics.touch.touch import Touch, TouchFrame

SINGLE = 1e-4  # tolerance of a contact that is no frame
HELD = 1e-5  # of grips that are no frame
F = TypeVar("F", GripFrame, TouchFrame)


def gripped(
    model: Predictor,
    held: Held,
    given: CommandLoads,
    nearest: bool,
    correct: bool,
    aim: float | None,
) -> GripFrame:
    """Find the forces of grips; InputError and WorkError as `Grip` and `Grip.move`."""
    grip = Grip(model, held, nearest, tolerance=HELD)
    given.notes += grip.notes
    ways = partial(grip.move, grip.displacements), partial(grip.correct, grip.displacements)
    return _shown(*ways, LoadedBody.of(model, given), correct, aim)


def pushed(
    model: Predictor, tool: str | Tool, given: CommandLoads, correct: bool, aim: float | None
) -> TouchFrame:
    """Find the forces of a tool; InputError and WorkError as `parse_tool` and `Touch.move`."""
    if isinstance(tool, str):
        tool = parse_tool(tool, model.body.geometry.dimension)
    touch = Touch(model, min(SINGLE, aim or SINGLE))
    ways = partial(touch.move, tool), partial(touch.correct, tool)
    return _shown(*ways, LoadedBody.of(model, given), correct, aim)


def _shown(
    move: Callable[..., F],
    correct: Callable[[LoadedBody], F],
    loaded: LoadedBody,
    is_corrected: bool,
    aim: float | None,
) -> F:
    """Find forces by predictions; then by what the solution shows, if that is more.

    That is the equilibrium of the finite elements together with what moves the body, or predictions
    that directions drive to a relative tolerance.
    """
    frame = move(loaded)
    if is_corrected:
        return correct(loaded)
    if aim is None or frame.correction is not None:
        return frame
    return move(loaded, predict=loaded.driven(aim))
