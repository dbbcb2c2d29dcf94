"""datagen run: solve every load case of a case."""

from __future__ import annotations

import argparse
from pathlib import Path

from datagen.commands.options import add_case
from shared_schema.common.command_line import Commands, add_command, laid_out


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "run",
        "solve every load case of a case (under mpirun, or not)",
        "mpirun -n 2 datagen run beam2d --out data/beam2d/nodal --samples 1000",
        "datagen run beam3d --out data/beam3d/nodal --dry-run",
    )
    add_case(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="nodal dataset to make"
    )
    parser.add_argument(
        "--samples", type=int, metavar="K", help="number of samples instead of the case's"
    )
    parser.add_argument(
        "--loads",
        type=Path,
        metavar="LOADS.h5",
        help="solve the load cases of a file (shared_schema.load_cases)",
    )
    parser.add_argument(
        "--ranks-per-solve", type=int, default=1, metavar="R", help="ranks that share each solve"
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="time some samples and print what the run would take; nothing is written",
    )
    parser.set_defaults(command=run, collective=True)


def run(options: argparse.Namespace) -> None:
    """Make the dataset, or resume it (collective)."""
    from mpi4py import MPI

    import datagen

    names = "samples", "volumetric", "changes", "loads", "trust", "ranks_per_solve"
    given = {name: getattr(options, name) for name in names}
    is_first = MPI.COMM_WORLD.rank == 0
    if options.dry_run:
        estimate = datagen.dry_run(options.case, **given)
        if is_first:
            print(laid_out(estimate.rows()))
        return
    manifest = datagen.run(options.case, options.out, **given)
    if is_first:
        print(f"{options.out}: {manifest.samples} samples solved, {manifest.failed} failed")
