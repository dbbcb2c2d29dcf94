"""surrogate learn-curve: the error over the number of training samples, on own data."""

from __future__ import annotations

import argparse
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_set
from surrogate.command_options import add_data, add_device, positive


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "learn-curve",
        "train on growing numbers of samples, and say how many an error needs",
        "surrogate learn-curve beam2d_any-det-fast --data data/beam2d_any/structured "
        "--samples 500,1000,2000 --goal 1e-4 --out runs/curve",
    )
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a recipe")
    add_data(parser, "structured dataset")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of runs, table and figure"
    )
    parser.add_argument(
        "--samples",
        type=counts,
        default=(),
        metavar="N,N,…",
        help="numbers of training samples (default: all, and halves of them); every training has "
        "as many steps as that on all samples",
    )
    parser.add_argument(
        "--goal",
        type=positive,
        metavar="M",
        help="mean error whose number of samples is told, in m or the unit of the case",
    )
    add_set(parser, "the configuration", "training.epochs=20")
    add_device(parser)
    parser.set_defaults(command=run)


def counts(text: str) -> tuple[int, ...]:
    """Read numbers of samples; ArgumentTypeError if they are none."""
    try:
        return tuple(int(count) for count in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}': expected numbers such as 100,200") from None


def run(options: argparse.Namespace) -> None:
    """Train and evaluate; print the curve."""
    import surrogate

    data, out = options.data, options.out
    config = surrogate.read_config(options.config, changes=options.changes, data=data)
    curve = surrogate.learning_curve(
        config, data, out, samples=options.samples, device=options.device
    )
    print(curve)
    for line in curve.outlook(options.goal):
        print(line)
