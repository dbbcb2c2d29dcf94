"""datagen export: write samples as a time series for ParaView."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.solution_file import require_suffix


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "export",
        "write samples as a time series for ParaView",
        "datagen export data/beam2d/nodal --out beam2d.xdmf --samples 0:20",
    )
    add_nodal(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.(xdmf|pvd)", help="file for ParaView"
    )
    parser.add_argument("--samples", metavar="A:B", help="A to B - 1 instead of the first 100")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the series."""
    from datagen.output.export import SUFFIXES, export

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    numbers = export(options.nodal, options.out, options.samples)
    print(f"{options.out}: {len(numbers)} samples, {numbers[0]} to {numbers[-1]}")
