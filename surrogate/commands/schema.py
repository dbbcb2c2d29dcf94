"""surrogate schema: print the keys of a configuration."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.configuration_keys import add_arguments, printed


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "schema",
        "print the keys of a configuration",
        "surrogate schema training",
        "surrogate schema --format json > config.schema.json",
    )
    add_arguments(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print the keys."""
    import surrogate

    print(printed(options, surrogate.config_keys(), surrogate.config_schema()))
