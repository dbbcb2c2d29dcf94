"""surrogate compare: errors of several runs beside each other, as a table and a figure."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.files import require_writable, write_text
from shared_schema.common.solution_file import require_suffix
from surrogate.command_options import RUN, add_device

FIGURES = (".png", ".svg", ".pdf")


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "compare",
        "compare the errors of runs on their test splits, in a table and a figure",
        "surrogate compare runs/beam2d-det-fast runs/beam2d-vb-fast --figure errors.pdf",
        "surrogate compare runs/one runs/other --data data/beam2d/structured",
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help=f"evaluated {RUN}")
    parser.add_argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="evaluate all runs on the test split of this dataset, without writing into them",
    )
    parser.add_argument("--figure", type=Path, metavar="FILE.(png|svg|pdf)", help="draw the errors")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the numbers as well")
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Print the table; draw the figure and write the numbers if asked to."""
    import surrogate
    from shared_schema.common.drawing.figure_style import save

    for path, suffixes, option in (
        (options.figure, FIGURES, "--figure"),
        (options.out, (".csv",), "--out"),
    ):
        if path is not None:
            require_suffix(path, suffixes, option)
            require_writable(path, option)
    comparison = surrogate.compare(options.runs, dataset=options.data, device=options.device)
    if options.figure is not None:
        save(comparison.plot(), options.figure)
    if options.out is not None:
        write_text(options.out, comparison.csv())
    print(comparison)
