"""The program ``python -m experiments``: studies, benchmarks and what needs a GPU."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from experiments import benchmark_commands, gpu_commands, study_commands
from shared_schema import __version__
from shared_schema.common import make_parser, run_command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code."""
    description = "The paper's studies and those beyond it, benchmarks, and what needs a GPU."
    parser, commands = make_parser("experiments", description, __version__)
    study_commands.add_to(commands)
    benchmark_commands.add_to(commands)
    gpu_commands.add_to(commands)
    options = parser.parse_args(arguments)
    return run_command("experiments", lambda: options.command(options))


if __name__ == "__main__":
    sys.exit(main())
