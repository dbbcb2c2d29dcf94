"""Training: from a configuration and a dataset to a model, with a checkpoint to resume from.

A checkpoint holds everything that the next epoch depends on. So a training that is stopped after k
epochs and resumed ends with the same weights, bit for bit, as one without a stop.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from pathlib import Path

import torch
from torch import Tensor

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import WorkError
from shared_schema.common.files import require_writable
from shared_schema.common.progress import Progress
from shared_schema.common.units import Units
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate, make_surrogate
from surrogate.learning.models.model import Model, TrainedModel
from surrogate.learning.models.training_config import RecalibratedTraining
from surrogate.learning.networks.field_network import FieldNetwork, parameter_count
from surrogate.learning.runs.config_reader import Config, Data, read_config
from surrogate.learning.runs.description import RunDescription, describe
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.checkpoint import load_checkpoint, save_checkpoint
from surrogate.learning.training.data_parallel import joined
from surrogate.learning.training.recalibration import recalibrate
from surrogate.learning.training.sample_store import DeviceStore
from surrogate.learning.training.setup import (
    Split,
    dataset_for,
    initial_network,
    make_trainer,
    require_a_sample_each,
    require_options,
    split_for,
    warm_start,
    warn_of_size,
)
from surrogate.learning.training.trainer import Trainer, all_finite
from surrogate.learning.training.training_log import (
    TrainingLog,
    advice,
    epoch_note,
    remark_on_start,
)
from surrogate.learning.training.validation import Reference, validate
from surrogate.mechanics.body.elements_of_case import warn_of_locking
from surrogate.runtime.device import hardware

logger = logging.getLogger(__name__)
DIVERGED = 1e3  # error of the validation samples in units of their displacements


@checked_arguments
def train(
    config: Config,
    dataset: Data,
    out: str | Path,
    *,
    device: str = "auto",
    stop_after: int | None = None,
    seconds: float = math.inf,
    tensorboard: bool = False,
    start_from: str | Path | None = None,
) -> Surrogate:
    """Fit a model, or train it to its last epoch, resuming from the run's checkpoint.

    Under ``torchrun`` the processes train together: each calls this function, and only the first
    one writes.

    Parameters
    ----------
    config : Model, mapping, str or Path
        Configuration, as `surrogate.read_config` takes it.
    dataset : Dataset, str, Path or sequence of str or Path
        Dataset, its folder, or the folders of several that are joined.
    out : str or Path
        Run folder; made if it does not exist.
    device : {"auto", "cpu", "cuda"}
    stop_after : int, optional
        Last epoch of this call; a checkpoint is written after it.
    seconds : float
        Time after which this call begins no further epoch; a checkpoint is written after the last.
    tensorboard : bool
        Also write files for TensorBoard.
    start_from : str or Path, optional
        Another run on the same body, whose weights the training starts from.

    Returns
    -------
    Surrogate
        The trained network, as `surrogate.load` returns it; of a training that was stopped before
        its end, the network as far as it is trained.

    Raises
    ------
    InputError
        If the dataset belongs to another case, the folder to another run or to another process, or
        a file in it is damaged.
    WorkError
        If the loss is no longer finite; the last good checkpoint is kept.
    """
    require_options(stop_after, seconds, tensorboard)
    config, run = read_config(config, data=dataset), RunFolder(Path(out))
    require_writable(run.folder)
    with joined(device) as (ranks, target), ExitStack() as held:
        ranks.from_first(lambda: require_a_sample_each(config, ranks.count))
        data = dataset_for(config, dataset)
        deadline = time.perf_counter() + seconds
        start = None if start_from is None else warm_start(start_from, config, data)
        split = split_for(config, data) if config.learns else None
        described = describe(config, data, None if start is None else start.origin)
        description = ranks.from_first(lambda: run.require_free(described))
        if run.is_finished and run.description().went_on_from == description.went_on_from:
            return load(run.folder, target.type)
        ranks.from_first(lambda: held.enter_context(run.owned()))
        ranks.from_first(lambda: warn_of_size(data))
        if split is None:
            ranks.from_first(lambda: derive(config, data, target, description, run))
        elif isinstance(config, TrainedModel):
            trainer = make_trainer(config, data, split, target, ranks, start)
            ranks.from_first(lambda: run.start(description))
            last = stop_after or config.training.epochs
            is_over = train_epochs(trainer, description, run, last, deadline, tensorboard)
            tensors = {**trainer.result(), **data.geometry.tensors()}
            if not is_over:
                return make_surrogate(tensors, description, target.type)
            rows = split.validation_rows
            ranks.from_first(lambda: finish(trainer, description, run, tensors, data, rows))
        else:
            ranks.from_first(lambda: fit(config, data, split, target, description, run))
        return load(run.folder, target.type)


def train_epochs(
    trainer: Trainer,
    description: RunDescription,
    run: RunFolder,
    last: int,
    deadline: float,
    tensorboard: bool,
) -> bool:
    """Train epoch by epoch, from the checkpoint if there is one, and write checkpoints.

    Parameters
    ----------
    trainer : Trainer
    description : RunDescription
    run : RunFolder
    last : int
        Last epoch of this call.
    deadline : float
        Time of `time.perf_counter` after which no further epoch begins.
    tensorboard : bool

    Returns
    -------
    bool
        True if the training is over.
    """
    config, ranks, units = trainer.config, trainer.ranks, description.data.units
    epoch, seconds = 0, 0.0
    if run.checkpoint.is_file():
        epoch, seconds = load_checkpoint(run.checkpoint, trainer.states(), trainer.optimisers)
        trainer.resume_after(epoch)
    if ranks.is_first and (remark := remark_on_start(trainer, description, epoch)):
        logger.info(remark)
    title = (
        f"surrogate train {config.name} ({parameter_count(trainer.network) / 1e6:.2f} M parameters)"
    )
    done = epoch * trainer.steps_per_epoch
    progress = Progress(trainer.steps, done, "steps", title, silent=not ranks.is_first)
    saved, saved_at, late = epoch, time.perf_counter(), False
    measures: dict[str, float] = {}
    with closing(TrainingLog(run, epoch, tensorboard, silent=not ranks.is_first)) as log:
        while epoch < last and not late and not trainer.is_over(epoch):
            began = time.perf_counter()
            measures = trainer.train_epoch(epoch, progress)
            trained = time.perf_counter()
            require_finite(trainer.network, measures["train_loss"], epoch + 1, saved)
            measures |= ranks.from_first(trainer.validate)
            require_bounded(trainer.network, measures, epoch + 1, units)
            epoch += 1
            trainer.finish_epoch(epoch, measures)
            trainer.note = epoch_note(epoch, measures, units)
            now = time.perf_counter()
            seconds += now - began
            rate = len(trainer.train) / (trained - began)
            log.write({"epoch": epoch, **measures, "seconds": seconds, "samples_per_second": rate})
            late = deadline < math.inf and ranks.from_first(lambda: time.perf_counter() > deadline)
            over = late or epoch == last or trainer.is_over(epoch)
            if over or now - saved_at > config.training.checkpoint_seconds:
                if ranks.is_first:
                    states, optimisers = trainer.states(), trainer.optimisers
                    save_checkpoint(run.checkpoint, epoch, seconds, states, optimisers)
                saved, saved_at = epoch, time.perf_counter()
    progress.close(", ".join(filter(None, (trainer.note, f"{seconds:.0f} s"))))
    is_over = trainer.is_over(epoch)
    if ranks.is_first and is_over and measures and (advised := advice(trainer, measures, units)):
        logger.info("advice: %s", advised)
    return is_over


def require_bounded(
    network: FieldNetwork, measures: Mapping[str, float], epoch: int, units: Units
) -> None:
    """Raise WorkError if errors on the validation samples are far beyond all displacements."""
    error, size = measures.get("validation_error", 0.0), float(network.displacement_rms)
    if error > DIVERGED * size:
        raise WorkError(
            f"diverged in epoch {epoch}, with an error of {error:.2g} {units.length} on validation "
            f"samples, whose displacements are {size:.2g} {units.length}; expected a smaller "
            "learning rate"
        )


def require_finite(network: FieldNetwork, loss: float, epoch: int, saved: int) -> None:
    """Raise WorkError if the loss of an epoch or a weight is not finite; name what is kept."""
    if not (math.isfinite(loss) and all_finite(network)):
        kept = f"the checkpoint of epoch {saved}" if saved else "no checkpoint"
        raise WorkError(f"diverged in epoch {epoch}, with a loss of {loss}; {kept} is kept")


def finish(
    trainer: Trainer,
    description: RunDescription,
    run: RunFolder,
    tensors: dict[str, Tensor],
    data: Dataset,
    validation_rows: Tensor,
) -> None:
    """Write the model of a training that is over, recalibrated if the configuration says so."""
    training = trainer.config.training
    if isinstance(training, RecalibratedTraining) and training.recalibrate:
        surrogate, level = make_surrogate(tensors, description), training.recalibrate
        held_out = data.nodal_train(validation_rows)
        recalibrate(surrogate, held_out, None if level is True else level)
        tensors = {**tensors, **surrogate.network.state_dict()}
    run.write_model(tensors, hardware(trainer.device))


def derive(
    config: Model,
    dataset: Dataset,
    device: torch.device,
    description: RunDescription,
    run: RunFolder,
) -> None:
    """Write a model that follows from the body, and one line with epoch 0."""
    began, data = time.perf_counter(), dataset.at_nodes()
    warn_of_locking(data.manifest.case, data.geometry.cell_type)
    network = config.build_for(data.geometry, data.info, data.material, data.manifest.case)
    run.start(description)
    with closing(TrainingLog(run, -1, tensorboard=False, silent=False)) as log:
        log.write({"epoch": 0, "seconds": time.perf_counter() - began})
    run.write_model({**network.state_dict(), **data.geometry.tensors()}, hardware(device))


def fit(
    config: Model,
    dataset: Dataset,
    split: Split,
    device: torch.device,
    description: RunDescription,
    run: RunFolder,
) -> None:
    """Write a model that is fitted directly, and one line of measures with epoch 0."""
    began = time.perf_counter()
    network = initial_network(config, dataset, split).to(device)
    run.start(description)
    with closing(TrainingLog(run, -1, tensorboard=False, silent=False)) as log:
        store = DeviceStore(network.prepared(split.validation.in_memory()), device)
        seconds = time.perf_counter() - began
        compared = Reference.of(network, dataset, split.validation, split.validation_rows)
        measures = validate(config, network, store, len(split.validation), compared)
        log.write({"epoch": 0, **measures, "seconds": seconds})
    run.write_model({**network.state_dict(), **dataset.geometry.tensors()}, hardware(device))
