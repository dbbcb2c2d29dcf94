"""surrogate refine: train on by the potential energy of random loads, without solutions."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command
from shared_schema.common.files import require_writable
from surrogate.command_options import RUN, add_device, add_family, positive, whole


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "refine",
        "train a network on by the potential energy of random loads, unsolved",
        "surrogate refine runs/beam2d --steps 1000 --out runs/beam2d-refined",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help=RUN)
    add_family(parser)
    parser.add_argument("--steps", type=whole, required=True, metavar="N", help="training steps")
    parser.add_argument(
        "--learning-rate",
        type=positive,
        default=3e-5,
        metavar="R",
        help="first one (default 3e-5)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the random loads")
    parser.add_argument("--out", type=Path, required=True, metavar="RUN", help="new run folder")
    add_device(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Train on, in a new run folder."""
    import surrogate
    from surrogate.learning.runs.folder import RunFolder

    require_writable(options.out)
    surrogate.refine(
        options.run,
        options.out,
        steps=options.steps,
        family=options.family,
        learning_rate=options.learning_rate,
        seed=options.seed,
        device=options.device,
    )
    found = RunFolder(options.out).metric_lines()[-1]["train_loss"]
    print(f"{options.out}: {options.steps} steps, potential energy {found:.4g} of the linear work")
