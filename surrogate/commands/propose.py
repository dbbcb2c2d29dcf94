"""surrogate propose: choose the load cases that are worth a solve."""

from __future__ import annotations

import argparse

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import add_device, add_family, add_out, add_run, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "propose",
        "choose the load cases of a random family that are predicted worst",
        "surrogate propose beam2d_any --count 100 --out loads.h5",
    )
    add_run(parser)
    add_family(parser)
    parser.add_argument("--count", type=whole, required=True, metavar="K", help="load cases")
    parser.add_argument(
        "--among",
        type=whole,
        metavar="M",
        help="number of random load cases that they are chosen from (default 20 K)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the random loads")
    add_out(parser, "LOADS.h5", "load cases for `datagen run`")
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Choose the load cases, and write them."""
    import surrogate
    from shared_schema.common.files import require_writable
    from shared_schema.common.solution_file import require_suffix

    require_suffix(options.out, (".h5",))
    require_writable(options.out)
    proposal = surrogate.propose(
        surrogate.load(options.run, options.device),
        options.count,
        family=options.family,
        among=options.among,
        seed=options.seed,
    )
    proposal.save(options.out)
    print(f"{options.out}: {proposal.summary()}")
