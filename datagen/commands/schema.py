"""datagen schema: the keys of a case file, with type, unit, default and meaning."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.configuration_keys import add_arguments, printed


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "schema",
        "print the keys of a case file",
        "datagen schema load",
        "datagen schema --format json > case.schema.json",
    )
    add_arguments(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print the keys; behind all of them, what the units are."""
    from datagen import case_keys, case_schema
    from shared_schema.common.units import GUIDANCE

    print(printed(options, case_keys(), case_schema()))
    if options.format == "text" and not options.key:
        print(f"\n{GUIDANCE}", end="")
