"""The command ``surrogate``: train, evaluate, predict, export, report, page, and others."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from shared_schema.common.command_line import Parser, make_parser, run_command
from surrogate.commands import evaluate, export, page, predict, report, shelf, studies, train

COMMANDS = (train, evaluate, predict, export, report, page, shelf, studies)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code (0 done, 1 failed, 2 wrong input, 3 not certified)."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], None] = options.command
    speaks = os.environ.get("RANK", "0") == "0"  # set by torchrun

    def run() -> None:
        from surrogate.hardware import memory_errors

        with memory_errors():
            command(options)

    return run_command("surrogate", run, speaks)


def _parser() -> Parser:
    from surrogate import __version__

    description = "Train and evaluate surrogates on datasets made by datagen."
    parser, commands = make_parser("surrogate", description, __version__)
    for command in COMMANDS:
        command.add_to(commands)
    return parser


if __name__ == "__main__":
    code = main()
    if "TORCHELASTIC_RUN_ID" in os.environ:  # set by torchrun
        # exit without the interpreter's cleanup: a thread of torch could abort the process in it
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
