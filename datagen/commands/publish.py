"""datagen publish: make a benchmark of a dataset, with a hidden test, for others."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.make import add_nodal
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.errors import InputError
from shared_schema.common.files import require_writable


def add_publish(commands: Commands) -> None:
    """Add ``datagen publish``."""
    parser = add_command(
        commands,
        "publish",
        "make a benchmark with a hidden test and a card, for Hugging Face and in the PLAID format",
        "datagen publish data/plate2d_shapes/nodal --license cc-by-4.0 --python plaid/bin/python "
        "--out plates",
    )
    add_nodal(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to make")
    parser.add_argument(
        "--license", required=True, metavar="TEXT", help="of the dataset, such as cc-by-4.0"
    )
    parser.add_argument("--owner", metavar="TEXT", help="of the dataset")
    parser.add_argument(
        "--python", type=Path, metavar="PYTHON", help="interpreter of an environment with pyplaid"
    )
    parser.add_argument(
        "--validation", type=float, metavar="PART", help="of all samples (default 0.05)"
    )
    parser.add_argument(
        "--baseline",
        action="append",
        default=[],
        metavar="NAME=FILE.npz",
        help="predictions for the test, whose scores are in the card; may be repeated",
    )
    parser.set_defaults(command=_publish)


def _publish(options: argparse.Namespace) -> None:
    """Write the folder, and say what is in it."""
    import datagen

    baselines = {}
    for word in options.baseline:
        name, _, path = word.rpartition("=")
        if not name or not path:
            raise InputError(f"--baseline {word}: expected NAME=FILE.npz")
        baselines[name] = path
    require_writable(options.out)
    names = "owner", "python", "validation"
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    counts = datagen.publish(
        options.nodal, options.out, license=options.license, baselines=baselines, **given
    )
    told = ", ".join(f"{count} {name}" for name, count in counts.items())
    print(f"{options.out}: {told} samples; keep answers.npz to yourself")
