"""datagen run: solve every load case of a case."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_case
from shared_schema.common.command_line import Commands


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = commands.add_parser(
        "run", help="solve every load case of a case (under mpirun, or not)"
    )
    add_case(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="nodal dataset to make"
    )
    parser.add_argument(
        "--samples", type=int, metavar="K", help="number of samples instead of the case's"
    )
    parser.add_argument(
        "--ranks-per-solve", type=int, default=1, metavar="R", help="ranks that share each solve"
    )
    parser.set_defaults(command=run, collective=True)


def run(options: argparse.Namespace) -> None:
    """Make the dataset, or resume it (collective)."""
    from mpi4py import MPI

    from datagen.cases.case import read_case
    from datagen.farm.farm import run

    case = read_case(
        options.case, options.volumetric, options.samples, options.trust, options.changes
    )
    manifest = run(case, options.out, MPI.COMM_WORLD, options.ranks_per_solve)
    if MPI.COMM_WORLD.rank == 0:
        print(f"{options.out}: {manifest.samples} samples solved, {manifest.failed} failed")
