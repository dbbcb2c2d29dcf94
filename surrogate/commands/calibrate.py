"""surrogate calibrate: calibrate the fast bounds of a run on random loads, without a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from surrogate.command_options import add_family, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "calibrate",
        "calibrate the fast bounds of a run on random loads, without a dataset",
        "surrogate calibrate runs/plate2d-series --loads 100",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, which is changed")
    parser.add_argument(
        "--loads", type=whole, default=100, metavar="N", help="corrected loads (default 100)"
    )
    parser.add_argument(
        "--fresh",
        type=whole,
        default=0,
        metavar="M",
        help="further loads, on which the bounds are measured (default 0)",
    )
    add_family(parser)
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the random loads")
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Calibrate, and say on how many loads."""
    import surrogate

    given = {name: getattr(options, name) for name in ("loads", "fresh", "family", "seed")}
    fast = surrogate.calibrate(options.run, **given)
    used = len(fast.ratios["mean"])
    print(f"{options.run}: fast bounds, calibrated on {used} of {options.loads} random loads")
