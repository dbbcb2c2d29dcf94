"""surrogate sample: make the samples of a body's case, without finite-element software."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import add_out, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "sample",
        "make the nodal dataset of a body, as datagen run does; resumes by itself",
        "surrogate sample data/organ/body --count 2000 --out data/organ/nodal --workers 4",
    )
    what = "dataset of the body, such as datagen body makes; its case says which loads are drawn"
    parser.add_argument("body", type=Path, metavar="BODY", help=what)
    parser.add_argument("--count", type=whole, required=True, metavar="N", help="number of samples")
    add_out(parser, "DIR", "folder of the dataset; one of fewer samples grows")
    parser.add_argument(
        "--seed", type=int, metavar="S", help="of the loads (default: that of the case)"
    )
    parser.add_argument(
        "--workers", type=whole, default=1, metavar="W", help="processes that solve (default 1)"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the samples, and say how many there are."""
    import surrogate

    given = {"seed": options.seed, "workers": options.workers}
    made = surrogate.sample(options.body, options.out, options.count, **given)
    failed = f", {made.failed} without equilibrium" if made.failed else ""
    print(f"{options.out}: {made.samples} samples{failed}; `datagen structure` maps them to a grid")
