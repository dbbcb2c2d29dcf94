"""datagen noise: copy a nodal dataset with the paper's noise on small loads."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.command_line import Commands


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = commands.add_parser("noise", help="copy a nodal dataset with noise on small loads")
    add_nodal(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--relative", type=float, default=0.2, help="largest relative change")
    parser.add_argument("--threshold", type=float, default=0.7, help="largest |f| with noise, in N")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the copy."""
    from datagen.structure.noise import add_noise

    manifest = add_noise(
        options.nodal, options.out, options.seed, options.relative, options.threshold
    )
    print(f"{options.out}: {manifest.samples} samples with noise")
