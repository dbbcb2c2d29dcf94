"""datagen list: the cases that come with the package."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "list",
        "list the cases that come with the package",
        "datagen list",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print a line for each case."""
    from datagen import shipped_cases
    from shared_schema.common.command_line import laid_out

    rows = [[str(value) for value in case] for case in shipped_cases()]
    print(laid_out([("case", "mesh", "load", "samples", ""), *rows]))
