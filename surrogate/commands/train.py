"""surrogate train: train a network, resume it, or go on with more epochs."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from shared_schema.common.atomic_file import require_writable
from shared_schema.common.command_line import Commands, add_command, add_set
from shared_schema.common.text_table import laid_out
from surrogate.commands.options import add_device, warn_unsealed


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "train",
        "train a network; resume it, or go on with more epochs",
        "surrogate train beam2d-det-fast --data data/beam2d/structured --out runs/beam2d",
        "surrogate train beam2d-det-fast --data data/beam2d/structured --out runs/beam2d "
        "--set training.epochs=100",
    )
    parser.add_argument("config", metavar="CONFIG", help="YAML file, or the name of a recipe")
    parser.add_argument(
        "--data",
        type=Path,
        required=True,
        action="append",
        metavar="DIR",
        help="structured dataset; repeated, several of one case are joined",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="RUN", help="run folder")
    add_set(parser, "the configuration", "training.epochs=20")
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
    from surrogate.data.joined_dataset import read_datasets
    from surrogate.device import choose_device
    from surrogate.models.model import TrainedModel
    from surrogate.runs.folder import RunFolder
    from surrogate.runs.run_config import read_config
    from surrogate.training.data_parallel import joined
    from surrogate.training.dry_run import dry_run
    from surrogate.training.train import stays_on_disk, train

    config = read_config(options.config, options.changes, options.data)
    if options.dry_run:
        data = read_datasets(options.data, on_disk=stays_on_disk(config))
        print(laid_out(dry_run(config, data, choose_device(options.device)).rows()))
        return
    run = RunFolder(options.out)
    require_writable(run.folder)
    with joined(options.device) as (ranks, device):
        dataset = read_datasets(options.data, on_disk=stays_on_disk(config))
        train(
            config,
            dataset,
            run,
            device,
            options.stop_after,
            ranks,
            options.tensorboard,
            options.seconds,
            options.start_from,
        )
    if not ranks.is_first:
        return
    lines = run.metric_lines()
    last = lines[-1] if lines else {"epoch": 0, "seconds": 0.0}
    warn_unsealed(run.folder)
    state = "trained" if run.is_finished else "stopped; resume with the same command"
    epochs = ""
    if isinstance(config, TrainedModel):
        epochs = f"{last['epoch']} of {config.training.epochs} epochs, "
    print(f"{options.out}: {state}, {epochs}{last['seconds']:.0f} s")
