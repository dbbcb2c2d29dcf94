"""datagen info: summarise a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, laid_out
from shared_schema.common.files import require_writable
from shared_schema.common.solution_file import require_suffix


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "info",
        "summarise a dataset",
        "datagen info data/beam2d/nodal --figure beam2d.png",
    )
    parser.add_argument("dataset", type=Path, metavar="DIR", help="nodal or structured dataset")
    parser.add_argument(
        "--figure", type=Path, metavar="FILE", help="draw the dataset as well, as `plot` does"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print the summary."""
    import datagen

    if options.figure is not None:
        from datagen.output.dataset_figure import SUFFIXES

        require_suffix(options.figure, SUFFIXES, "--figure")
        require_writable(options.figure, "--figure")
        datagen.plot(options.dataset, options.figure)
    print(laid_out(datagen.info(options.dataset).items()))
