"""Common code of both command lines: running a command, exit codes, progress."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from typing import TypeAlias

from tqdm import tqdm

from shared_schema.common.errors import (
    DONE,
    FAILED,
    NOT_CERTIFIED,
    WRONG_INPUT,
    InputError,
    NotCertifiedError,
    StoppedError,
    WorkError,
    first_line,
)

LINE_EVERY = 10.0  # seconds between progress lines where there is no terminal
Parser: TypeAlias = argparse.ArgumentParser
Commands: TypeAlias = (
    "argparse._SubParsersAction[argparse.ArgumentParser]"  # argparse gives this type no public name
)


def make_parser(program: str, description: str, version: str) -> tuple[Parser, Commands]:
    """Make the parser of a program, and the object to which its commands are added."""
    parser = argparse.ArgumentParser(
        prog=program,
        description=description,
        epilog="Exit codes: 0 done, 1 the work failed, 2 the input is wrong, 3 not certified.",
    )
    parser.add_argument("--version", action="version", version=f"{program} {version}")
    return parser, parser.add_subparsers(required=True, metavar="COMMAND")


def add_set(parser: Parser, file: str, example: str) -> None:
    """Add --set, which changes keys of the YAML file that the command reads."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="changes",
        metavar="KEY=VALUE",
        help=f"another value of a key of {file}, such as {example}; repeatable",
    )


def run_command(program: str, command: Callable[[], None], speaks: bool = True) -> int:
    """Run a command and turn what it raises into an exit code and one line on stderr.

    Parameters
    ----------
    program : str
        Name of the program, the first word of the line.
    command : callable
    speaks : bool
        Print errors that every rank raises (wrong input, a stop); true on one rank only.
    """
    try:
        command()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads the output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except InputError as error:
        if speaks:
            print(f"{program}: error: {error}", file=sys.stderr)
        return WRONG_INPUT
    except NotCertifiedError as error:
        print(f"{program}: not certified: {error}", file=sys.stderr)
        return NOT_CERTIFIED
    except (WorkError, OSError) as error:
        print(f"{program}: failed: {error}", file=sys.stderr)
        return FAILED
    except MemoryError as error:
        print(f"{program}: failed: out of memory ({first_line(error)})", file=sys.stderr)
        return FAILED
    except (StoppedError, KeyboardInterrupt):
        if speaks:
            print(f"{program}: stopped; resume with the same command", file=sys.stderr)
        return FAILED
    return DONE


class Progress:
    """Progress with rate and remaining time: a bar on a terminal, plain lines elsewhere.

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
        Show nothing.
    """

    def __init__(
        self, total: int, done: int = 0, unit: str = "", title: str = "", silent: bool = False
    ) -> None:
        self._total, self._start, self._done = total, done, done
        self._unit, self._title, self._silent = unit, title, silent
        self._began = time.perf_counter()
        self._last_line = self._began
        on_terminal = sys.stderr.isatty() and not silent
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
