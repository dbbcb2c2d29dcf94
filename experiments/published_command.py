"""Command published: the paper's numbers for a run, as `surrogate evaluate --beside` reads them."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "published",
        "print the paper's numbers for a run, for surrogate evaluate and report --beside",
        "python -m experiments published runs/beam2d > published.yaml",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print the numbers as YAML; an empty mapping for a case that the paper does not have."""
    from experiments.paper.published_numbers import PAPER, as_yaml
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.shelf import find_run

    of = RunFolder(find_run(options.run)).description().run
    print(as_yaml(PAPER.published(of.case, of.likelihood)), end="")
