"""The command ``python -m experiments``: the paper's tables and figures, and what goes beyond."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from experiments import published_command, studies_command
from shared_schema.common.command_line import make_parser, run_command
from surrogate import __version__


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code."""
    description = "Do the studies of the paper and those beyond it."
    parser, commands = make_parser("experiments", description, __version__)
    studies_command.add_to(commands)
    published_command.add_to(commands)
    options = parser.parse_args(arguments)
    return run_command("experiments", lambda: options.command(options))


if __name__ == "__main__":
    sys.exit(main())
