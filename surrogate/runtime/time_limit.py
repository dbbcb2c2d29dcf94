"""A limit of time on work in a thread.

Nothing ends a thread from outside. So what every step of a search does, which is a prediction,
out-of-balance forces or a linear response, asks first whether there is time left.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from time import monotonic


class OutOfTimeError(Exception):
    """The work has taken longer than its limit, or was stopped; it has no result."""


class TimeLimit:
    """A limit on every piece of work that runs under it.

    Parameters
    ----------
    seconds : float
    """

    def __init__(self, seconds: float = inf) -> None:
        self.seconds = seconds
        self._end, self._is_stopped = inf, False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the work in this block, in this thread, take `seconds` from now."""
        self._end = monotonic() + self.seconds
        before = _present.set(self)
        try:
            yield
        finally:
            _present.reset(before)

    def stop(self) -> None:
        """End the present work and all that follows, from any thread."""
        self._is_stopped = True

    @property
    def is_over(self) -> bool:
        """True if the present work is to end."""
        return self._is_stopped or monotonic() > self._end


_present: ContextVar[TimeLimit | None] = ContextVar("time limit", default=None)


def require_time() -> None:
    """Raise OutOfTimeError if this thread works under a limit, and that is over."""
    limit = _present.get()
    if limit is not None and limit.is_over:
        raise OutOfTimeError
