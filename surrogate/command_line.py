"""The command ``surrogate``: trains, evaluates, predicts and exports."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module

from shared_schema.common.command_line import Parser, make_parser, parsed, run_command
from surrogate.command_options import speaks
from surrogate.extensions import CONTRIB

NAMES = (  # in the order of the help
    "init schema sample train evaluate calibrate compare predict simulate "
    "identify actuate balance export report page touch serve list shelve"
)
ELSEWHERE = {**CONTRIB, **dict.fromkeys(("list", "shelve"), "surrogate.commands.shelf")}
COMMANDS = {
    name: ELSEWHERE.get(name, f"surrogate.commands.{name.replace('-', '_')}")
    for name in NAMES.split()
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input, 3 not certified)."""
    given = sys.argv[1:] if arguments is None else arguments
    options = parsed(_parser(*given[:1]), arguments)
    command: Callable[[argparse.Namespace], None] = options.command

    def run() -> None:
        from surrogate.runtime.device import flush_denormals, memory_errors

        flush_denormals()
        with memory_errors():
            command(options)

    return run_command("surrogate", run, speaks())


def _parser(command: str | None = None) -> Parser:
    """Make the parser of one command, or of all if there is none of this name."""
    from surrogate import __version__

    description = "Train and evaluate surrogates on datasets made by datagen."
    names = {"config": _config_names, "run": _run_names, "runs": _run_names}
    parser, commands = make_parser("surrogate", description, __version__, names)
    modules = [COMMANDS[command]] if command in COMMANDS else dict.fromkeys(COMMANDS.values())
    for module in modules:
        import_module(module).add_to(commands)
    return parser


def _config_names() -> list[str]:
    from shared_schema.common.configuration import names_in
    from surrogate.learning.runs.config_reader import SHIPPED

    return names_in(SHIPPED)


def _run_names() -> list[str]:
    from surrogate.learning.runs.shelf import shelved

    return shelved()


if __name__ == "__main__":
    code = main()
    if "TORCHELASTIC_RUN_ID" in os.environ:  # set by torchrun
        # exit without the interpreter's cleanup: a thread of torch could abort the process in it
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
