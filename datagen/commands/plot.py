"""datagen plot: draw mesh, supports and some samples of a dataset, or a body."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_nodal
from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import require_suffix


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "plot",
        "draw mesh, supports and some samples of a dataset, or a body",
        "datagen plot data/beam2d/nodal --out beam2d.pdf --samples 0,7",
    )
    add_nodal(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.(png|svg|pdf)", help="figure to write"
    )
    parser.add_argument(
        "--samples", metavar="N,N,…", help="sample numbers instead of four chosen by displacement"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Draw the figure."""
    from datagen import plot
    from datagen.output.dataset_figure import SUFFIXES

    require_suffix(options.out, SUFFIXES)
    require_writable(options.out)
    numbers = plot(options.nodal, options.out, samples=options.samples)
    shown = f"samples {', '.join(str(number) for number in numbers)}" if numbers else "the body"
    print(f"{options.out}: {shown}")
