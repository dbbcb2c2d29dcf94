"""Forces of held places and of a tool, which `Surrogate.solve` adds to a load."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.tools import parse_tool
from surrogate.mechanics.touch.grip import Grip, GripFrame
from surrogate.mechanics.touch.loaded_body import LoadedBody
from surrogate.mechanics.touch.touch import Touch, TouchFrame

if TYPE_CHECKING:
    from surrogate.learning.inference.solving import Wanted
    from surrogate.learning.inference.surrogate import Surrogate

SINGLE = 1e-4  # tolerance of a contact that is no frame
HELD = 1e-5  # of grips that are no frame
F = TypeVar("F", GripFrame, TouchFrame)


def with_sought_forces(
    model: Surrogate, given: CommandLoads, wanted: Wanted
) -> tuple[GripFrame | None, TouchFrame | None]:
    """Add the forces of held places or of a tool to a load; return the frame that has them."""
    loaded = LoadedBody.of(model, given)
    if wanted.held is not None:
        grip = Grip(model, wanted.held, wanted.nearest, tolerance=HELD)
        given.notes += grip.notes
        ways = partial(grip.move, grip.displacements), partial(grip.correct, grip.displacements)
        held = shown(*ways, loaded, wanted)
        nodes = len(given.forces)
        given.forces += held.force[:nodes]
        given.between[: len(held.force) - nodes] += held.force[nodes:]
        return held, None
    tool = wanted.tool
    tool = parse_tool(tool, model.geometry.dimension) if isinstance(tool, str) else tool
    assert tool is not None
    touch = Touch(model, min(SINGLE, wanted.tolerance or SINGLE))
    contact = shown(partial(touch.move, tool), partial(touch.correct, tool), loaded, wanted)
    given.forces += np.where(model.geometry.held, 0.0, contact.force)
    return None, contact


def shown(
    move: Callable[..., F], correct: Callable[[LoadedBody], F], loaded: LoadedBody, wanted: Wanted
) -> F:
    """Find forces by predictions; then by what the solution shows, if that is more.

    That is the equilibrium of the finite elements together with what moves the body, or predictions
    that directions drive to a relative tolerance.
    """
    frame = move(loaded)
    if wanted.correct:
        return correct(loaded)
    if wanted.tolerance is None or frame.correction is not None:
        return frame
    return move(loaded, predict=loaded.driven(wanted.tolerance))
