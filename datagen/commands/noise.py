"""datagen noise: copy a nodal dataset with the paper's noise on small loads."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.command_line import Commands, add_command


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "noise",
        "copy a nodal dataset with noise on small loads",
        "datagen noise data/beam2d/nodal --out data/beam2d-noisy/nodal --relative 0.1",
    )
    add_nodal(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="dataset to make")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the noise (default 0)"
    )
    parser.add_argument(
        "--relative",
        type=float,
        default=0.2,
        metavar="R",
        help="largest relative change (default 0.2)",
    )
    parser.add_argument(
        "--threshold",
        type=float,
        default=0.7,
        metavar="F",
        help="largest |f| with noise, in N (default 0.7)",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the copy."""
    from datagen import add_noise

    given = {name: getattr(options, name) for name in ("seed", "relative", "threshold")}
    manifest = add_noise(options.nodal, options.out, **given)
    print(f"{options.out}: {manifest.samples} samples with noise")
