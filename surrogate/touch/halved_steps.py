"""A way that is gone in steps, which are halved where they fail."""

from __future__ import annotations

from collections.abc import Callable

from shared_schema.common.errors import WorkError

SMALLEST = 1 / 64  # step, as a part of the way


def halved_steps(go: Callable[[float], object], missing: Callable[[float], str]) -> None:
    """Go all the way.

    Parameters
    ----------
    go : callable
        Goes on to a part of the way, up to 1; WorkError if that fails, and then nothing is changed.
    missing : callable
        Says what is not found beyond a part of the way.

    Raises
    ------
    WorkError
        If the smallest step fails.
    """
    share, step = 0.0, 1.0
    while share < 1.0:
        aim = min(1.0, share + step)
        try:
            go(aim)
        except WorkError as error:
            step /= 2
            if step < SMALLEST:
                raise WorkError(f"{missing(share)} ({error})") from None
        else:
            share, step = aim, 2 * step
