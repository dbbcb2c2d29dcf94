"""Progress of long work: shown by the commands, silent in Python unless asked for."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from tqdm import tqdm

LINE_EVERY = 10.0  # seconds between progress lines where there is no terminal
SHORT = 1.0  # seconds of passing work that show no bar
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
    passing : bool
        Leave no bar and no last line, of work whose result is told afterwards, and show no bar
        where it takes a moment only.
    """

    def __init__(
        self,
        total: int,
        done: int = 0,
        unit: str = "",
        title: str = "",
        silent: bool = False,
        passing: bool = False,
    ) -> None:
        self._total, self._start, self._done = total, done, done
        self._unit, self._title = unit, title
        self._silent, self._passing = silent or not _SHOWN.get(), passing
        self._began = time.perf_counter()
        self._last_line = self._began
        on_terminal = sys.stderr.isatty() and not self._silent
        self._bar = (
            tqdm(
                total=total,
                initial=done,
                unit=f" {unit}",
                desc=title,
                dynamic_ncols=True,
                miniters=0,  # of units: a note may change without any
                leave=not passing,
                delay=SHORT if passing else 0.0,
            )
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
        elif not self._silent and not self._passing:
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


class LoadProgress:
    r"""Progress of a load that Newton's method brings up, in parts of it or at once.

    Between the equilibria of the load factors s and s', the logarithm of the residual says how far
    Newton's method is: with the residual :math:`‖R_k‖` before step k, the largest one so far
    :math:`‖R_{max}‖`, and the tolerance ε,

    .. math:: s + (s' - s) \frac{\ln ‖R_{max}‖ - \ln ‖R_k‖}{\ln ‖R_{max}‖ - \ln ε}

    of the load is done. It never goes back.

    Parameters
    ----------
    title : str
    force : str
        Label of forces.
    silent : bool
        Show nothing, also in a command.
    """

    def __init__(self, title: str, force: str = "N", silent: bool = False) -> None:
        self._progress = Progress(100, 0, "% of the load", title, silent, passing=True)
        self._force, self._parts, self._largest, self.part = force, (0.0, 1.0), 0.0, 0.0

    def begin(self, reached: float, target: float) -> None:
        """Say that Newton's method starts from the equilibrium at s for the one at s'."""
        self._parts = reached, target

    def step(self, number: int, residual: float, tolerance: float) -> None:
        """Say which step of Newton's method comes next, from 0, with ‖R‖ before it and ε in N."""
        reached, target = self._parts
        self._largest, way = residual if number == 0 else max(self._largest, residual), 0.0
        if 0.0 < tolerance < self._largest < math.inf and residual > 0.0:
            way = math.log(self._largest / residual) / math.log(self._largest / tolerance)
        self.part = max(self.part, reached + (target - reached) * min(way, 1.0))
        note = f"Newton step {number + 1} to {target:.3g} of it, residual {residual:.2g}"
        self._progress.update(int(100 * self.part), f"{note} {self._force}")

    def close(self) -> None:
        """Finish."""
        self._progress.close()
