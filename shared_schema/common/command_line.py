"""Common code of both command lines: parsers, exit codes, options that name loads, tables."""

from __future__ import annotations

import argparse
import io
import logging
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeAlias

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
    nearest,
)
from shared_schema.common.progress import shown_progress

SHELLS = ("bash", "zsh")
COMPLETE = {  # function that completes names and paths: its name, the names
    "bash": '{0}() {{ compgen -W "{1}" -- "$1"; compgen -f -- "$1"; }}',
    "zsh": "{0}() {{ compadd -- {1}; _files }}",
}
UNKNOWN = re.compile(r"(?:unrecognized arguments: |COMMAND: invalid choice: ')(-*[\w-]+)")
NEGATIVE = re.compile(r"-\.?\d")  # beginning of numbers and lists of numbers
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
    parser: Parser = _Program(
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


class _Program(argparse.ArgumentParser):
    """A parser that asks for the option or command that is nearly the unknown one."""

    def error(self, message: str) -> NoReturn:
        """Print how the program is used, and what is wrong; exit 2."""
        if found := UNKNOWN.search(message):
            commands = _commands_of(self)
            options = (of._option_string_actions for of in (self, *commands.values()))
            message += nearest(found[1], [*commands, *(name for each in options for name in each)])
        super().error(message)


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
        for command in _commands_of(parser).values():
            for action in command._actions:
                if action.dest in self.names:
                    action.complete = {values: f"_{parser.prog}_{action.dest}"}  # type: ignore[attr-defined]
                elif action.type is Path:
                    action.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, values, preamble="\n".join(lines)))
        parser.exit()


def _commands_of(parser: Parser) -> Mapping[str, Parser]:
    """Return the parsers of all commands of a program, by their names."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return action.choices
    return {}


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
    parser = commands.add_parser(
        name,
        help=what,
        description=f"{what[:1].upper()}{what[1:]}.",
        epilog="\n  ".join(["example:" if len(examples) == 1 else "examples:", *examples]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.register("type", Path, _path)
    parser._negative_number_matcher = NEGATIVE  # a vector such as -1,0 is no option
    return parser


def _path(text: str) -> Path:
    """Read a path; ArgumentTypeError for an empty text, which would be the working directory."""
    if not text:
        raise argparse.ArgumentTypeError("expected a path, not an empty text")
    return Path(text)


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


class _OnStderr(logging.Handler):
    """Prints messages of the library as ``program: warning: …`` (``program: …`` if only news)."""

    def __init__(self, program: str) -> None:
        super().__init__(logging.INFO)
        self.program = program

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        kind = "warning: " if record.levelno >= logging.WARNING else ""
        print(f"{self.program}: {kind}{record.getMessage()}", file=sys.stderr, flush=True)


@contextmanager
def logged(program: str) -> Iterator[None]:
    """Print what a program and the code it shares log, while a command runs."""
    handler = _OnStderr(program)
    loggers = [logging.getLogger(name) for name in (program, "shared_schema")]
    before = [(logger.level, logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False
    try:
        yield
    finally:
        for logger, (level, propagate) in zip(loggers, before, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
            logger.propagate = propagate


def parsed(parser: Parser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the arguments of a command line; SystemExit after an error or the help."""
    _let_streams_take_everything()
    try:
        try:
            return parser.parse_args(arguments)
        finally:
            sys.stdout.flush()  # of the help
    except BrokenPipeError:
        raise SystemExit(nobody_reads()) from None


def _let_streams_take_everything() -> None:
    """Let what is printed go nowhere if a stream is closed, and escape what it cannot encode."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def nobody_reads() -> int:
    """End quietly when whoever reads the output, such as `head`, has seen enough: the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:  # what is left goes nowhere, at the end of the process as well
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return FAILED


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
        with logged(program), shown_progress():
            command()
        sys.stdout.flush()
    except BrokenPipeError:
        return nobody_reads()
    except InputError as error:
        if speaks:
            print(f"{program}: error: {error.of_command}", file=sys.stderr)
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


def laid_out(rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table, one line a row; every column is as wide as its widest cell."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in cells
    )
    return "\n".join(line.rstrip() for line in lines)


STRESSES = "add stresses, strain energy and reactions"


def add_held(parser: argparse.ArgumentParser) -> None:
    """Add ``--hold``."""
    parser.add_argument(
        "--hold",
        dest="held",
        action="append",
        default=[],
        metavar="X,Y[,Z]|GROUP:UX,UY[,UZ]",
        help="displacement in m of the node at X,Y[,Z] or of a group, - for a free component; "
        "repeatable",
    )


class _Named(argparse.Action):
    """Collect NAME=VALUE, each name once, in a mapping."""

    def __call__(
        self, parser: Parser, options: argparse.Namespace, text: Any, option: str | None = None
    ) -> None:
        """Add one."""
        name, _, value = text.partition("=")
        found: dict[str, float] = dict(getattr(options, self.dest))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not name or name in found or not math.isfinite(number):
            said = f"'{text}': expected NAME=VALUE, each name once"
            raise argparse.ArgumentError(self, said)
        setattr(options, self.dest, {**found, name: number})


def add_parameter(parser: argparse.ArgumentParser) -> None:
    """Add ``--parameter``."""
    parser.add_argument(
        "--parameter",
        dest="parameters",
        action=_Named,
        default={},
        metavar="NAME=VALUE",
        help="parameter of the body's shape, of a mesh with ranges of some (default: the middle of "
        "the range); repeatable",
    )


def add_tool(parser: argparse.ArgumentParser) -> None:
    """Add ``--tool``."""
    forms = "sphere:X,Y[,Z]:R|capsule:X,Y[,Z]:X,Y[,Z]:R|plane:X,Y[,Z]:NX,NY[,NZ]|mesh:FILE"
    parser.add_argument(
        "--tool",
        metavar=forms,
        help="rigid tool that the surface of the body keeps out of, in m; a plane "
        "has the normal that points out of it",
    )


def add_loads(parser: argparse.ArgumentParser) -> None:
    """Add ``--load``, ``--forces``, ``--body-force`` and ``--nearest``."""
    parser.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="X,Y[,Z][,R]|GROUP:FX,FY[,FZ]",
        help="force in N at the node at X,Y[,Z] in m, or spread smoothly over the surface within R "
        "m of this place, or on a group of the mesh, uniform over its cells or facets; GROUP:P is "
        "a pressure in Pa; repeatable",
    )
    parser.add_argument(
        "--forces",
        action="append",
        default=[],
        type=Path,
        metavar="FILE.(npz|csv)",
        help="forces of a solution file, or lines X,Y[,Z],FX,FY[,FZ]; repeatable",
    )
    parser.add_argument(
        "--body-force",
        metavar="BX,BY[,BZ]",
        help="force in N per m³ of the undeformed body, such as its weight 0,0,-9810",
    )
    parser.add_argument(
        "--nearest", action="store_true", help="let forces act at the nearest node, and say which"
    )
