"""datagen import: make a nodal dataset of one in the PLAID format."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_set


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "import",
        "make a nodal dataset of a PLAID dataset whose samples have one mesh",
        "datagen import beam2d-plaid --python plaid/bin/python --out data/beam2d-plaid/nodal",
        "datagen import theirs --inputs fx,fy --outputs ux,uy "
        "--set 'material={young_modulus: 500, poisson_ratio: 0.4}' --out data/theirs/nodal",
    )
    parser.add_argument("source", type=Path, metavar="PLAID_DIR", help="PLAID dataset on disk")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="nodal dataset to make"
    )
    parser.add_argument(
        "--inputs", metavar="F,F,…", help="fields of the force (default force_x,force_y,…)"
    )
    parser.add_argument(
        "--outputs",
        metavar="U,U,…",
        help="fields of the displacement (default displacement_x,displacement_y,…)",
    )
    parser.add_argument(
        "--python", type=Path, metavar="PYTHON", help="interpreter of an environment with pyplaid"
    )
    add_set(parser, "the case", "'material={young_modulus: 500, poisson_ratio: 0.4}'")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the dataset, and say how large it is."""
    from datagen import import_plaid

    manifest = import_plaid(
        options.source,
        options.out,
        inputs=options.inputs,
        outputs=options.outputs,
        python=options.python,
        changes=options.changes,
    )
    print(f"{options.out}: {manifest.samples} samples; next: datagen structure")
