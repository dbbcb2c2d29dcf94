"""surrogate propose: choose the load cases that are worth a solve."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command
from surrogate.commands.options import RUN, add_device, add_family, warn_unsealed, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "propose",
        "choose the load cases of a random family that are predicted worst",
        "surrogate propose beam2d_any --count 100 --out loads.h5",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    add_family(parser)
    parser.add_argument("--count", type=whole, required=True, metavar="K", help="load cases")
    parser.add_argument(
        "--among",
        type=whole,
        metavar="M",
        help="number of random load cases that they are chosen from (default 20 K)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the random loads")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="LOADS.h5", help="load cases for `datagen run`"
    )
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Choose the load cases, and write them."""
    from statistics import median

    from shared_schema.common.errors import InputError
    from shared_schema.common.solution_file import require_suffix
    from shared_schema.load_cases import LoadCases, write_load_cases
    from shared_schema.manifest import digest_of
    from surrogate.certify.proposal import propose
    from surrogate.data.random_loads import random_loads
    from surrogate.device import choose_device
    from surrogate.inference.loading import load
    from surrogate.inference.prediction import require_passes

    require_suffix(options.out, (".h5",))
    require_writable(options.out)
    warn_unsealed(options.run)
    surrogate = load(options.run, choose_device(options.device).type)
    geometry, data = surrogate.geometry, surrogate.description.data
    family = random_loads(options.family, geometry, data.info.force.max_abs, data.load_numbers)
    among = 20 * options.count if options.among is None else options.among
    if among < options.count:
        raise InputError(f"--among {among}: expected {options.count} at least, the number proposed")
    require_passes(1, options.seed)
    proposal = propose(surrogate, family, options.count, among, options.seed)
    cases = LoadCases.of(geometry.coordinates, proposal.forces)
    write_load_cases(options.out, cases, digest_of(data.case), geometry.cell_type)
    print(
        f"{options.out}: {options.count} load cases of {among}, estimated mean error "
        f"{1e3 * median(proposal.errors):.3g} mm in the median, of all "
        f"{1e3 * proposal.median:.3g} mm"
    )
