"""surrogate train: train a network, resume it, or go on with more epochs."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_set
from shared_schema.common.errors import InputError
from surrogate.command_options import add_data, add_device, seeds, speaks

SHORT = 1e-9  # s, for an epoch
PASSED_ON = ("device", "stop_after", "tensorboard", "start_from")


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "train",
        "train a network; resume it, or go on with more epochs",
        "surrogate train beam2d-det-fast --data data/beam2d/structured --out runs/beam2d",
        "surrogate train beam2d-det-fast --data data/beam2d/structured --out runs/beam2d "
        "--set training.epochs=100",
        "surrogate train beam2d-det-fast --data data/beam2d/structured --out runs/beam2d-seeds "
        "--seeds 0:5",
    )
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a recipe")
    what = "structured dataset; repeated, several of one case are joined"
    add_data(parser, what, several=True)
    parser.add_argument("--out", type=Path, required=True, metavar="RUN", help="run folder")
    add_set(parser, "the configuration", "training.epochs=20")
    parser.add_argument(
        "--seeds",
        type=seeds,
        metavar="A:B",
        help="train with each seed from A to B - 1, in RUN/seed-A …; surrogate evaluate RUN then "
        "says how far they spread",
    )
    add_device(parser)
    parser.add_argument(
        "--stop-after",
        type=int,
        metavar="EPOCH",
        help="stop after this epoch, with a checkpoint to resume from",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=math.inf,
        metavar="S",
        help="begin no epoch after this time, and write a checkpoint to resume from",
    )
    parser.add_argument(
        "--tensorboard", action="store_true", help="write TensorBoard's files into the run folder"
    )
    parser.add_argument(
        "--start-from",
        type=Path,
        metavar="RUN",
        help="start from the weights of another run on the same body, on any dataset of it; the "
        "learning rate begins anew",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="time some steps and print what the training would take; nothing is written",
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Train, and say how far."""
    import surrogate
    from surrogate.learning.runs.folder import RunFolder

    config = surrogate.read_config(options.config, changes=options.changes, data=options.data)
    if options.dry_run:
        print(surrogate.dry_run(config, options.data, device=options.device))
        return
    if options.seeds and (options.out / "config.yaml").is_file():
        raise InputError(f"--out '{options.out}': a run, expected a folder for the runs of --seeds")
    if options.seeds and any(change.partition("=")[0] == "seed" for change in options.changes):
        raise InputError("--set seed and --seeds: expected one of them")
    given = {name: getattr(options, name) for name in PASSED_ON}
    began, left = time.monotonic(), options.seconds
    for seed in options.seeds or [config.seed]:
        out = options.out / f"seed-{seed}" if options.seeds else options.out
        seeded = config.model_copy(update={"seed": seed})
        surrogate.train(seeded, options.data, out, seconds=left, **given)
        if speaks():
            print(f"{out}: {RunFolder(out).progress()}", flush=True)
        if options.seconds < math.inf and not RunFolder(out).is_finished:
            break  # on all ranks alike
        left = max(began + options.seconds - time.monotonic(), SHORT)
