"""surrogate report: write a run's results as one HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import RUN


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "report",
        "write a run's results as one HTML page",
        "surrogate report runs/beam2d --nodal data/beam2d/nodal --out report.html",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=f"an evaluated {RUN}")
    parser.add_argument(
        "--nodal", type=Path, metavar="DIR", help="nodal dataset; the page shows its solve times"
    )
    parser.add_argument(
        "--beside",
        type=Path,
        metavar="FILE.yaml",
        help="published numbers, shown beside those of the run",
    )
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FILE.json",
        help="evaluation.json of another run, whose numbers are shown too",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.html", help="page to write"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Write the page, and print its path."""
    import surrogate

    published = surrogate.read_published(options.beside) if options.beside else None
    surrogate.write_report(
        options.run,
        options.out,
        nodal=options.nodal,
        published=published,
        against=options.against,
    )
    print(options.out.resolve())
