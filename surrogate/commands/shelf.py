"""surrogate list and shelve: what comes with the package, and how a network is added."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command


def add_to(commands: Commands) -> None:
    """Add the two parsers."""
    listed = add_command(
        commands,
        "list",
        "list the trained networks and configurations that come with the package",
        "surrogate list",
    )
    listed.set_defaults(command=run_list)

    shelve = add_command(
        commands,
        "shelve",
        "put a run among the trained networks of the package",
        "surrogate shelve runs/beam2d_any beam2d_any",
    )
    shelve.add_argument("run", type=Path, metavar="RUN", help="an evaluated run folder")
    shelve.add_argument("name", metavar="NAME", help="name of the network, such as its case")
    shelve.set_defaults(command=run_shelve)


def run_list(options: argparse.Namespace) -> None:
    """Print a line for each network, and one for each configuration."""
    import surrogate

    print(f"{surrogate.trained_list()}\n\n{surrogate.config_list()}")


def run_shelve(options: argparse.Namespace) -> None:
    """Copy a run into the package."""
    import surrogate
    from surrogate.learning.runs.shelf import size_of

    folder = surrogate.shelve(options.run, options.name)
    print(f"{folder}: {size_of(folder) / 1e6:.1f} MB")
