"""surrogate balance: let a reduced network predict coefficients of least potential energy."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import add_run, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "balance",
        "let a reduced network predict the least potential energy in its modes",
        "surrogate balance runs/finger",
    )
    add_run(parser)
    points = "quadrature points of the energy (default 200)"
    parser.add_argument("--points", type=whole, default=200, metavar="N", help=points)
    loads = "random loads that they are chosen for (default 150)"
    parser.add_argument("--loads", type=whole, default=150, metavar="N", help=loads)
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the random loads")
    copy = "write a copy of the run instead of changing it"
    parser.add_argument("--out", type=Path, metavar="DIR", help=copy)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Fit the cubature, and write it into the run or a copy."""
    from surrogate.contrib.modal_fit import cubature_file, fit_balance
    from surrogate.learning.inference.loading import load
    from surrogate.learning.runs.folder import RunFolder
    from surrogate.learning.runs.shelf import copy_run, find_run, require_changeable

    require_changeable(options.run, options.out)
    cubature = fit_balance(load(options.run), options.points, options.loads, options.seed)
    source = find_run(options.run)
    run = RunFolder(source if options.out is None else copy_run(source, options.out))
    run.write_cubature(cubature_file(cubature))
    print(f"{run.folder}: least energy in modes by {len(cubature.weights)} points")
