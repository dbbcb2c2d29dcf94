"""datagen body: make the dataset of a body without samples."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_case
from shared_schema.common.command_line import Commands, add_command


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "body",
        "make the dataset of a body without samples, for a surrogate that needs none",
        "datagen body beam3d_any --out data/beam3d_any/body",
        "datagen body plate2d --set mesh.parameters.radius=0.2 --out data/plate2d/body",
    )
    add_case(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="dataset to make")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the dataset, and say how large the body is."""
    import datagen

    given = {name: getattr(options, name) for name in ("volumetric", "changes", "trust")}
    manifest = datagen.body(options.case, options.out, **given)
    print(f"{options.out}: body of {manifest.name}, without samples")
