"""Errors and exit codes that both command lines share.

======  ==========================================================================
code    meaning
======  ==========================================================================
0       done
1       the work failed, with the reason (a load case without equilibrium, say)
2       the input is wrong: one line with the key, the value and what was expected
3       the work is done, and its result is not certified (`surrogate predict --certify`), or not
        within the tolerance that was asked for
======  ==========================================================================
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

DONE, FAILED, WRONG_INPUT, NOT_CERTIFIED = 0, 1, 2, 3


def first_line(error: BaseException) -> str:
    """First line of an error's text, or its name if it has none."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def nearest(name: str, names: Iterable[str]) -> str:
    """Ask for the name among some that is nearly the same; empty if there is none."""
    close = get_close_matches(name, list(names), 1)
    return f"; did you mean '{close[0]}'?" if close else ""


class InputError(Exception):
    """The user's input is wrong; the message is the one line that the user sees (exit code 2).

    Parameters
    ----------
    message : str
    argument : str
        Name of an argument in Python with which the message begins.
    """

    def __init__(self, message: str = "", argument: str = "") -> None:
        super().__init__(message)
        self.argument = argument

    @property
    def of_command(self) -> str:
        """The message of a command, whose options are named as the arguments are."""
        named = self.argument
        option = f"--{named.replace('_', '-')}" if named else ""
        return option + str(self).removeprefix(named)


class StoppedError(Exception):
    """The work was stopped on request and can be resumed (exit code 1)."""


class WorkError(Exception):
    """The input was right and the work failed; the message is the reason (exit code 1)."""


class NotCertifiedError(Exception):
    """The result was written and is not certified; the message says why (exit code 3)."""
