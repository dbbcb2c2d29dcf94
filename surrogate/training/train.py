"""Training: from a configuration and a dataset to a model, with a checkpoint to resume from.

A checkpoint holds everything that the next epoch depends on. So a training that is stopped after k
epochs and resumed ends with the same weights, bit for bit, as one without a stop.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from shared_schema.common.atomic_file import write_text
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.progress import Progress
from surrogate.data.dataset import Dataset
from surrogate.data.mirror import with_mirror_images
from surrogate.data.sample_paths import SamplePaths
from surrogate.data.sample_store import DeviceStore
from surrogate.data.samples import Samples
from surrogate.data.samples_on_disk import SamplesOnDisk
from surrogate.device import lay_out
from surrogate.hardware import hardware, require_device_memory
from surrogate.inference.loading import load, make_surrogate
from surrogate.models.model import Model, TrainedModel
from surrogate.models.training_config import RecalibratedTraining
from surrogate.networks.field_network import FieldNetwork
from surrogate.networks.unet import parameter_count
from surrogate.runs.description import RunDescription, describe
from surrogate.runs.folder import RunFolder
from surrogate.runs.split import TrainingSplit, split_training
from surrogate.seeds import ORDER, stream
from surrogate.training.checkpoint import load_checkpoint, save_checkpoint
from surrogate.training.cuda_graph import can_capture
from surrogate.training.data_parallel import ALONE, Ranks
from surrogate.training.kept_load_paths import compute_missing, read_paths, require_path_memory
from surrogate.training.memory_estimate import training_memory
from surrogate.training.recalibration import recalibrate
from surrogate.training.trainer import Trainer
from surrogate.training.training_log import TrainingLog, require_tensorboard
from surrogate.training.validation import validate
from surrogate.training.warm_start import warm_start

OVERFITTED = 2.0  # ratio of validation and training errors from which on more samples help


def all_finite(network: torch.nn.Module) -> bool:
    """Return True if no weight is NaN or infinite."""
    return bool(torch.stack([torch.isfinite(p).all() for p in network.parameters()]).all())


def train(
    config: Model,
    dataset: Dataset,
    run: RunFolder,
    device: torch.device,
    stop_after: int | None = None,
    ranks: Ranks = ALONE,
    tensorboard: bool = False,
    seconds: float = math.inf,
    start_from: Path | None = None,
) -> None:
    """Fit a model, or train it to its last epoch, resuming from the run's checkpoint.

    Parameters
    ----------
    config : Model
    dataset : Dataset
    run : RunFolder
        Run folder; made if it does not exist.
    device : torch.device
    stop_after : int, optional
        Last epoch of this call; a checkpoint is written after it.
    ranks : Ranks
        Processes that train together; each calls this function, and only the first one writes.
    tensorboard : bool
        Also write files for TensorBoard.
    seconds : float
        Time after which this call begins no further epoch; a checkpoint is written after the last.
    start_from : Path, optional
        Folder of another run on the same body, whose weights the training starts from.

    Raises
    ------
    InputError
        If the dataset belongs to another case, the folder to another run or to another process, or
        a file in it is damaged.
    WorkError
        If the loss is no longer finite; the last good checkpoint is kept.
    """
    if stop_after is not None and stop_after < 1:
        raise InputError(f"--stop-after {stop_after}: expected an epoch, 1 at least")
    if not seconds > 0:
        raise InputError(f"--seconds {seconds:g}: expected more than 0")
    if tensorboard:
        require_tensorboard()
    deadline = time.perf_counter() + seconds
    start = None if start_from is None else warm_start(start_from, config, dataset)
    require_samples_at(config, dataset)
    split = split_training(dataset.training, config)
    if isinstance(config, TrainedModel) and config.training.batch_size < ranks.count:
        raise InputError(
            f"config '{config.name}': key 'training.batch_size' = {config.training.batch_size}, "
            f"expected {ranks.count} at least, the number of processes"
        )
    config.require_suitable(dataset, split.train)
    described = describe(config, dataset, None if start is None else start.origin)
    description = ranks.from_first(lambda: run.require_free(described))
    if run.is_finished and run.description().went_on_from == description.went_on_from:
        load(run.folder)
        return
    if isinstance(config, TrainedModel):
        split = replace(split, train=mirrored(split.train, config, dataset))
        batch = min(-(-config.training.batch_size // ranks.count), len(split.train))
        require_device_memory(
            training_memory(config, dataset.geometry, batch),
            f"config '{config.name}': keys 'network', 'ensemble', 'training.batch_size': training",
            device,
        )
    with ExitStack() as held:
        ranks.from_first(lambda: held.enter_context(run.owned()))
        began = time.perf_counter()
        material = dataset.material if config.needs_material else None
        body = dataset.geometry, dataset.info, material
        network = config.build_for(*body, dataset.manifest.case)
        if start is None:
            config.start_from_data(network, dataset, first_samples(split, config.seed))
        else:
            start.apply(network)
        if isinstance(config, TrainedModel):
            ranks.from_first(lambda: require_paths(config, dataset, split.train_rows))
            paths = paths_of(config, dataset, split.train_rows)
            trainer = make_trainer(config, network, split, dataset, device, ranks, paths)
            ranks.from_first(lambda: run.start(description))
            _train(trainer, description, dataset, run, stop_after, deadline, tensorboard)
        elif ranks.is_first:
            run.start(description)
            _finish_fit(config, network.to(device), split, dataset, run, began)


def going_on(config: TrainedModel, before: int, steps_per_epoch: int) -> str:
    """Say what more epochs do to the learning rate of a training that has ended.

    Parameters
    ----------
    config : TrainedModel
        Configuration with the new number of epochs.
    before : int
        Number of epochs after which the training had ended.
    steps_per_epoch : int
    """
    schedule, epochs = config.training.schedule, config.training.epochs
    done = before * steps_per_epoch
    last = schedule.factor(done - 1, done)
    first = schedule.factor(done, epochs * steps_per_epoch)
    rate = f"the learning rate goes on at {first:.3g} of its peak"
    if abs(last - first) > 0.01:
        rate = (
            f"the learning rate, {last:.3g} of its peak at the end, starts again at {first:.3g}, "
            f"as after {before} of {epochs} epochs; the weights are not those of {epochs} at once"
        )
    return f"config '{config.name}': going on from epoch {before} to {epochs}; {rate}"


def beginning_anew(config: TrainedModel, other: str) -> str:
    """Say what happens to the learning rate of a training from the weights of another run."""
    peak = config.training.optimiser.learning_rate
    return (
        f"config '{config.name}': starting from the weights of '{other}'; the learning rate begins "
        f"its schedule anew, with a peak of {peak:g}; a smaller one stays closer to them"
    )


def mirrored(
    train: Samples | SamplesOnDisk, config: TrainedModel, dataset: Dataset
) -> Samples | SamplesOnDisk:
    """Training samples with their mirror images, if the configuration asks for them."""
    axes, key = config.training.mirrors, f"config '{config.name}': key 'training.mirrors'"
    if not axes:
        return train
    if isinstance(train, SamplesOnDisk):
        raise InputError(f"{key} = {list(axes)}: expected none of samples on disk")
    return with_mirror_images(train, dataset.geometry, axes, key)


def require_paths(config: TrainedModel, dataset: Dataset, rows: Tensor) -> None:
    """Compute the load paths of the training samples that are not there; check the memory."""
    count, key = config.training.load_paths, f"config '{config.name}': key 'training.load_paths'"
    if count and isinstance(dataset.training, SamplesOnDisk):
        raise InputError(f"{key} = {count}: expected 0 of samples on disk")
    if count:
        images = 2 ** len(config.training.mirrors)
        require_path_memory(dataset, count, images * len(rows), key)
        compute_missing(dataset, rows, count)


def paths_of(config: TrainedModel, dataset: Dataset, rows: Tensor) -> SamplePaths | None:
    """Load paths of the training samples and their mirror images; None without them."""
    training, key = config.training, f"config '{config.name}': key 'training.mirrors'"
    if not training.load_paths:
        return None
    paths = read_paths(dataset, rows, training.load_paths)
    return paths.with_mirror_images(dataset.geometry, training.mirrors, key)


def first_samples(split: TrainingSplit[Samples | SamplesOnDisk], seed: int) -> Samples:
    """Training samples that a network starts from: all, or random ones of those on disk."""
    if isinstance(split.train, Samples):
        return split.train
    return split.train.some(torch.Generator().manual_seed(stream(seed, ORDER)))


def stays_on_disk(config: Model) -> bool:
    """True if the training samples of a configuration are not read into memory."""
    return isinstance(config, TrainedModel) and config.training.samples_on == "disk"


def require_samples_at(config: Model, dataset: Dataset) -> None:
    """Raise InputError unless the samples are on disk exactly if the configuration says so."""
    on_disk = stays_on_disk(config)
    if on_disk != isinstance(dataset.training, SamplesOnDisk):
        found, expected = ("in memory", "on disk") if on_disk else ("on disk", "in memory")
        raise InputError(f"config '{config.name}': the samples are {found}, expected {expected}")


def make_trainer(
    config: TrainedModel,
    network: FieldNetwork,
    split: TrainingSplit[Samples | SamplesOnDisk],
    dataset: Dataset,
    device: torch.device,
    ranks: Ranks = ALONE,
    paths: SamplePaths | None = None,
) -> Trainer:
    """Move a network to the device and make its trainer."""
    lay_out(network, dataset.geometry.dimension, config.training.precision, device)
    if config.training.cuda_graphs and ranks.is_first and not can_capture(device, ranks.count):
        print(
            f"surrogate: warning: config '{config.name}': 'training.cuda_graphs' is for one "
            f"process on cuda, here {ranks.count} on {device.type}; training continues without it",
            file=sys.stderr,
        )
    return Trainer(config, network, split.train, split.validation, ranks, paths)


def _train(
    trainer: Trainer,
    description: RunDescription,
    dataset: Dataset,
    run: RunFolder,
    stop_after: int | None,
    deadline: float,
    tensorboard: bool,
) -> None:
    """Train epoch by epoch and write checkpoints; write the model after the last epoch."""
    config, network, ranks = trainer.config, trainer.network, trainer.ranks
    start, seconds = 0, 0.0
    if run.checkpoint.is_file():
        start, seconds = load_checkpoint(run.checkpoint, trainer.states(), trainer.optimisers)
        trainer.resume_after(start)
        if description.went_on_from and start == description.went_on_from[-1] and ranks.is_first:
            print(f"surrogate: {going_on(config, start, trainer.steps_per_epoch)}", file=sys.stderr)
    elif description.start_from is not None and ranks.is_first:
        said = beginning_anew(config, description.start_from.run)
        print(f"surrogate: {said}", file=sys.stderr)
    start_epoch = start
    progress = Progress(
        trainer.steps,
        start * trainer.steps_per_epoch,
        "steps",
        f"surrogate train {config.name} ({parameter_count(network) / 1e6:.2f} M parameters)",
        silent=not ranks.is_first,
    )
    epoch, saved = start, time.perf_counter()
    largest = max(dataset.info.displacement.max_abs)
    last = stop_after or config.training.epochs
    late = False
    with closing(TrainingLog(run, start, tensorboard, silent=not ranks.is_first)) as log:
        while epoch < last and not late and not trainer.is_over(epoch):
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
            trainer.note = epoch_note(epoch, measures, largest)
            now = time.perf_counter()
            seconds += now - began
            rate = len(trainer.train) / (trained - began)
            log.write({"epoch": epoch, **measures, "seconds": seconds, "samples_per_second": rate})
            late = deadline < math.inf and ranks.from_first(lambda: time.perf_counter() > deadline)
            over = late or epoch == last or trainer.is_over(epoch)
            if over or now - saved > config.training.checkpoint_seconds:
                if ranks.is_first:
                    save_checkpoint(
                        run.checkpoint, epoch, seconds, trainer.states(), trainer.optimisers
                    )
                start, saved = epoch, time.perf_counter()
    progress.close(", ".join(filter(None, (trainer.note, f"{seconds:.0f} s"))))
    if ranks.is_first and trainer.is_over(epoch) and epoch > start_epoch:
        advised = advice(trainer, measures)
        if advised:
            print(f"surrogate: advice: {advised}", file=sys.stderr)
    if ranks.is_first and trainer.is_over(epoch):
        tensors = {**trainer.result(), **dataset.geometry.tensors()}
        if isinstance(config.training, RecalibratedTraining) and config.training.recalibrate:
            surrogate, level = make_surrogate(tensors, description), config.training.recalibrate
            held_out = trainer.validation.in_memory()
            recalibrate(surrogate, held_out, None if level is True else level)
            tensors |= surrogate.network.state_dict()
        write_model(run, trainer.device, tensors)


def epoch_note(epoch: int, measures: Mapping[str, float], largest: float) -> str:
    """Describe an epoch for the progress line.

    Parameters
    ----------
    epoch : int
    measures : mapping of str to float
        Its line of measures; errors in m.
    largest : float
        Largest displacement component of the training samples in m.
    """
    note = f"epoch {epoch}, loss {measures['train_loss']:.3g}"
    if "validation_error" not in measures:
        return note
    error = measures["validation_error"]
    relative = f" ({error / largest:.2%} of the largest displacement)" if largest > 0 else ""
    return f"{note}, validation error {error:.2e} m{relative}"


def advice(trainer: Trainer, measures: Mapping[str, float]) -> str | None:
    """Say if the validation samples show that there are too few training samples.

    Parameters
    ----------
    trainer : Trainer
        Trainer of a training that is over.
    measures : mapping of str to float
        Measures of the last epoch.
    """
    if "validation_error" not in measures:
        return None
    error, on_training = measures["validation_error"], trainer.training_error()
    if not error > OVERFITTED * on_training:
        return None
    return (
        f"the error on validation samples is {error:.2e} m, on training samples "
        f"{on_training:.2e} m; more than {len(trainer.train)} training samples would help "
        "(`datagen run CASE --samples K` lets a dataset grow)"
    )


def _finish_fit(
    config: Model,
    network: FieldNetwork,
    split: TrainingSplit[Samples | SamplesOnDisk],
    dataset: Dataset,
    run: RunFolder,
    began: float,
) -> None:
    """Write a model that is fitted directly, and one line of measures with epoch 0."""
    device = network.displacement_rms.device
    with closing(TrainingLog(run, -1, tensorboard=False, silent=False)) as log:
        store = DeviceStore(network.prepared(split.validation.in_memory()), device)
        seconds = time.perf_counter() - began
        measures = validate(config, network, store, len(split.validation))
        log.write({"epoch": 0, **measures, "seconds": seconds})
    write_model(run, device, {**network.state_dict(), **dataset.geometry.tensors()})


def write_model(run: RunFolder, device: torch.device, tensors: dict[str, Tensor]) -> None:
    """Write the name of the hardware, then the weights."""
    write_text(run.hardware, hardware(device) + "\n")
    run.write_tensors(tensors)
