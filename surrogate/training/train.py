"""Training: from a configuration and a dataset to a model, with a checkpoint to go on from.

What a checkpoint holds is all that the next epoch depends on, so that k + k epochs are 2k, bit for
bit.
"""

from __future__ import annotations

import math
import sys
import time
from contextlib import closing

import torch

from shared_schema.common.atomic_file import write_text
from shared_schema.common.command_line import Progress
from shared_schema.common.errors import InputError, WorkError
from surrogate.data.dataset import Dataset
from surrogate.data.geometry import Geometry
from surrogate.device import lay_out
from surrogate.hardware import hardware
from surrogate.inference.prediction import make_surrogate
from surrogate.networks.unet import parameter_count
from surrogate.runs.configuration import RunConfig
from surrogate.runs.description import describe
from surrogate.runs.folder import RunFolder
from surrogate.runs.network import make_network, require_suitable, start_from_data
from surrogate.runs.split import split_parts
from surrogate.training.checkpoint import load_checkpoint, save_checkpoint
from surrogate.training.cuda_graph import can_capture
from surrogate.training.data_parallel import ALONE, Ranks
from surrogate.training.trainer import Trainer
from surrogate.training.training_log import TrainingLog, require_tensorboard
from surrogate.uncertainty.recalibration import recalibrate


def all_finite(network: torch.nn.Module) -> bool:
    """Tell whether no weight is NaN or infinite."""
    return all(bool(torch.isfinite(p).all()) for p in network.parameters())


def train(
    config: RunConfig,
    dataset: Dataset,
    run: RunFolder,
    device: torch.device,
    stop_after: int | None = None,
    ranks: Ranks = ALONE,
    tensorboard: bool = False,
) -> None:
    """Train a network, or go on from the run's checkpoint, to its last epoch.

    Parameters
    ----------
    config : RunConfig
    dataset : Dataset
    run : RunFolder
        Made if it is not there.
    device : torch.device
    stop_after : int, optional
        Stop after this epoch, with a checkpoint to go on from.
    ranks : Ranks
        The processes that train together; each calls this, and the first one writes.
    tensorboard : bool
        Write TensorBoard's files as well.

    Raises
    ------
    InputError
        If the dataset is of another case, or the folder of another run.
    WorkError
        If the loss is no longer finite; the last good checkpoint is kept.
    """
    if stop_after is not None and stop_after < 1:
        raise InputError(f"--stop-after {stop_after}: expected an epoch, 1 at least")
    if tensorboard:
        require_tensorboard()
    description, training = describe(config, dataset), config.training
    parts = split_parts(dataset.train, config)
    if training.batch_size < ranks.count:
        raise InputError(
            f"config '{config.name}': key 'training.batch_size' = {training.batch_size}, expected "
            f"{ranks.count} at least, the number of processes"
        )
    require_suitable(config, dataset, parts.train)
    ranks.from_first(lambda: run.start(description))
    if run.model.is_file():
        return
    began = time.perf_counter()
    network = make_network(description, dataset.geometry)
    if not run.checkpoint.is_file():
        start_from_data(network, config, dataset, parts.train)
    lay_out(network, dataset.geometry.dimension, training.precision, device)
    if training.cuda_graphs and ranks.is_first and not can_capture(device, ranks.count):
        print(
            f"surrogate: warning: config '{config.name}': 'training.cuda_graphs' is for one "
            f"process on cuda, here {ranks.count} on {device.type}; going on without",
            file=sys.stderr,
        )
    node_fraction = float(dataset.geometry.grid.mask.mean())
    trainer = Trainer(config, network, parts.train, parts.validation, node_fraction, ranks)
    if config.model == "pod":
        _finish_fit(trainer, dataset.geometry, run, time.perf_counter() - began)
        return
    start, seconds = 0, 0.0
    if run.checkpoint.is_file():
        start, seconds = load_checkpoint(run.checkpoint, trainer.parts(), trainer.optimisers)

    progress = Progress(
        trainer.steps,
        start * trainer.steps_per_epoch,
        "steps",
        f"surrogate train {config.name} ({parameter_count(network) / 1e6:.2f} M parameters)",
        silent=not ranks.is_first,
    )
    epoch, saved = start, time.perf_counter()
    last = stop_after or training.epochs
    with closing(TrainingLog(run, start, tensorboard, silent=not ranks.is_first)) as log:
        while epoch < last and not trainer.is_over(epoch):
            began = time.perf_counter()
            measures = trainer.train_epoch(epoch, progress)
            trained = time.perf_counter()
            loss = measures["train_loss"]
            if not (math.isfinite(loss) and all_finite(network)):
                kept = f"the checkpoint of epoch {start}" if start else "no checkpoint"
                raise WorkError(
                    f"diverged in epoch {epoch + 1}, with a loss of {loss}; {kept} is kept"
                )
            measures |= ranks.from_first(trainer.validate)
            epoch += 1
            trainer.finish_epoch(epoch, measures)
            now = time.perf_counter()
            seconds += now - began
            rate = len(parts.train) / (trained - began)
            log.write({"epoch": epoch, **measures, "seconds": seconds, "samples_per_second": rate})
            over = epoch == last or trainer.is_over(epoch)
            if over or now - saved > training.checkpoint_seconds:
                if ranks.is_first:
                    save_checkpoint(
                        run.checkpoint, epoch, seconds, trainer.parts(), trainer.optimisers
                    )
                start, saved = epoch, time.perf_counter()
    progress.close(f"{seconds:.0f} s")
    if ranks.is_first and trainer.is_over(epoch):
        tensors = {**trainer.result(), **dataset.geometry.tensors()}
        if training.recalibrate:
            surrogate = make_surrogate(tensors, description)
            recalibrate(surrogate, parts.validation)
            tensors |= surrogate.network.state_dict()
        write_text(run.hardware, hardware(device) + "\n")
        run.write_tensors(tensors)


def _finish_fit(trainer: Trainer, geometry: Geometry, run: RunFolder, seconds: float) -> None:
    """Write what is fitted rather than trained: one line of measures, of epoch 0, and the model."""
    if trainer.ranks.is_first:
        with closing(TrainingLog(run, -1, tensorboard=False, silent=False)) as log:
            log.write({"epoch": 0, **trainer.validate(), "seconds": seconds})
        write_text(run.hardware, hardware(trainer.device) + "\n")
        run.write_tensors({**trainer.network.state_dict(), **geometry.tensors()})
