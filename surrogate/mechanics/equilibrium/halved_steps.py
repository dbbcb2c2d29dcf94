"""A way to a state in steps, which are halved where they fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from shared_schema.common.errors import WorkError

State = TypeVar("State")
SMALLEST = 1 / 64  # part of the way


def halved_steps(go: Callable[[float, State], State], begin: State, missing: str) -> State:
    """Go a way in steps, which are halved where they fail, and return the state at its end.

    Parameters
    ----------
    go : callable
        Goes on to a part of the way, up to 1, from the last state to the next one; WorkError if
        that fails, and then nothing is changed.
    begin : object
        The first state.
    missing : str
        Says what is not found beyond a part of the way, which takes the place of braces.

    Raises
    ------
    WorkError
        If the smallest step fails.
    """
    share, step, state = 0.0, 1.0, begin
    while share < 1.0:
        aim = min(1.0, share + step)
        try:
            state = go(aim, state)
        except WorkError as error:
            step /= 2
            if step < SMALLEST:
                raise WorkError(f"{missing.format(share)} ({error})") from None
        else:
            share, step = aim, 2 * step
    return state
