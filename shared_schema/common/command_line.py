"""Common code of both command lines: running a command, exit codes, progress."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

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

SHELLS = ("bash", "zsh")
COMPLETE = {  # function that completes names and paths: its name, the names
    "bash": '{0}() {{ compgen -W "{1}" -- "$1"; compgen -f -- "$1"; }}',
    "zsh": "{0}() {{ compadd -- {1}; _files }}",
}
LINE_EVERY = 10.0  # seconds between progress lines where there is no terminal
Parser: TypeAlias = argparse.ArgumentParser
Commands: TypeAlias = (
    "argparse._SubParsersAction[argparse.ArgumentParser]"  # argparse gives this type no public name
)


def make_parser(
    program: str,
    description: str,
    version: str,
    names: Mapping[str, Callable[[], Iterable[str]]] = MappingProxyType({}),
) -> tuple[Parser, Commands]:
    """Make the parser of a program, and the object to which its commands are added.

    Parameters
    ----------
    program, description, version : str
    names : mapping of str to callable
        Functions that list names which an argument takes beside paths, by the argument's name in
        the parsed options; for completion in a shell.
    """
    parser = argparse.ArgumentParser(
        prog=program,
        description=description,
        epilog="Exit codes: 0 done, 1 the work failed, 2 the input is wrong, 3 not certified.",
    )
    parser.add_argument("--version", action="version", version=f"{program} {version}")
    parser.add_argument(
        "--print-completion",
        action=_PrintCompletion,
        choices=SHELLS,
        names=names,
        help="print the script that completes commands and names in a shell",
    )
    return parser, parser.add_subparsers(required=True, metavar="COMMAND")


class _PrintCompletion(argparse.Action):
    """Print the completion script of a shell, made by shtab, and end."""

    def __init__(self, names: Mapping[str, Callable[[], Iterable[str]]], **options: Any) -> None:
        super().__init__(**options)
        self.names = names

    def __call__(self, parser: Parser, namespace: Any, values: Any, option: Any = None) -> None:
        try:
            import shtab
        except ImportError:
            parser.error(f"argument {option}: expected the package shtab, which is not installed")
        lines = []
        for name, listed in self.names.items():
            lines.append(COMPLETE[values].format(f"_{parser.prog}_{name}", " ".join(listed())))
        for command in _commands_of(parser):
            for action in command._actions:
                if action.dest in self.names:
                    action.complete = {values: f"_{parser.prog}_{action.dest}"}  # type: ignore[attr-defined]
                elif action.type is Path:
                    action.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, values, preamble="\n".join(lines)))
        parser.exit()


def _commands_of(parser: Parser) -> Iterable[Parser]:
    """Return the parsers of all commands of a program."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return action.choices.values()
    return ()


def add_command(commands: Commands, name: str, what: str, *examples: str) -> Parser:
    """Add the parser of a command to those of its program.

    Parameters
    ----------
    commands : Commands
    name : str
    what : str
        What the command does, in one line.
    examples : str
        Command lines that show its use.
    """
    return commands.add_parser(
        name,
        help=what,
        description=f"{what[:1].upper()}{what[1:]}.",
        epilog="\n  ".join(["example:" if len(examples) == 1 else "examples:", *examples]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


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
