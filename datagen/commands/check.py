"""datagen check: check every byte of a dataset against the schema."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.errors import InputError


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "check",
        "check every byte of a dataset against the schema",
        "datagen check data/beam2d/nodal",
    )
    parser.add_argument("dataset", type=Path, metavar="DIR", help="nodal or structured dataset")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print every violation, or that there is none."""
    from datagen import check
    from shared_schema.dataset_reader import DatasetReader, unstable_samples
    from shared_schema.manifest import find_unfinished, growing

    problems = check(options.dataset)
    if len(problems) == 1:
        raise InputError(problems[0])
    if problems:
        print("\n".join(problems), file=sys.stderr)
        raise InputError(f"{options.dataset}: {len(problems)} violations of the schema")
    growth = find_unfinished(options.dataset)
    rest = "" if growth is None else f"; {growing(growth)}"
    unstable = DatasetReader(options.dataset).unstable()
    if unstable is not None and len(unstable):
        rest = f"; {unstable_samples(unstable)}{rest}"
    print(f"{options.dataset}: intact{rest}")
