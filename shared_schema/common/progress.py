"""Progress of long work: shown by the commands, silent in Python unless asked for."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from tqdm import tqdm

LINE_EVERY = 10.0  # seconds between progress lines where there is no terminal
_SHOWN: ContextVar[bool] = ContextVar("shown progress", default=False)


@contextmanager
def shown_progress() -> Iterator[None]:
    """Show the progress of all work inside; the commands do, and so may a notebook."""
    token = _SHOWN.set(True)
    try:
        yield
    finally:
        _SHOWN.reset(token)


class Progress:
    """Progress with rate and remaining time: a bar on a terminal, plain lines elsewhere.

    It is silent outside of `shown_progress`, that is, where no command runs.

    Parameters
    ----------
    total : int
        Total number of units of work.
    done : int
        Number of units done before this start.
    unit : str
        Name of a unit, for the rate.
    title : str
    silent : bool
        Show nothing, also in a command.
    """

    def __init__(
        self, total: int, done: int = 0, unit: str = "", title: str = "", silent: bool = False
    ) -> None:
        self._total, self._start, self._done = total, done, done
        self._unit, self._title = unit, title
        self._silent = silent or not _SHOWN.get()
        self._began = time.perf_counter()
        self._last_line = self._began
        on_terminal = sys.stderr.isatty() and not self._silent
        self._bar = (
            tqdm(total=total, initial=done, unit=f" {unit}", desc=title, dynamic_ncols=True)
            if on_terminal
            else None
        )

    def update(self, done: int, note: str = "") -> None:
        """Show the total number of units done, with a note such as the current loss."""
        advanced = done - self._done
        self._done = done
        if self._bar is not None:
            if note:
                self._bar.set_postfix_str(note, refresh=False)
            self._bar.update(advanced)
        elif not self._silent and time.perf_counter() - self._last_line >= LINE_EVERY:
            self._print(note)

    def close(self, note: str = "") -> None:
        """Finish the bar, or print the last line."""
        if self._bar is not None:
            self._bar.close()
        elif not self._silent:
            self._print(note)

    def _print(self, note: str) -> None:
        now = time.perf_counter()
        self._last_line = now
        elapsed = now - self._began
        rate = (self._done - self._start) / elapsed if elapsed > 0 else 0.0
        left = (
            f"{(self._total - self._done) / rate:.0f} s left" if rate > 0 else "time left unknown"
        )
        text = f"{self._title}: {self._done}/{self._total} {self._unit}, {rate:.1f}/s, {left}"
        print(text + (f", {note}" if note else ""), file=sys.stderr, flush=True)
