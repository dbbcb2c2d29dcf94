"""What a training says: where it starts, the measures of every epoch, advice at its end.

Measures are lines of ``metrics.jsonl`` and, optionally, files for TensorBoard.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping

from shared_schema.common.errors import InputError
from shared_schema.common.units import SI, Units
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.runs.description import RunDescription
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.seal import append_line
from surrogate.learning.training.trainer import Trainer

Line = Mapping[str, float]
LARGE_PART = 0.5  # of the error, from which on a finer grid helps more than more samples
OVERFITTED = 2.0  # ratio of validation and training errors from which on more samples help


class TrainingLog:
    """The measures of a run, one line per epoch.

    Parameters
    ----------
    run : RunFolder
    epoch : int
        Last finished epoch; lines of later epochs are deleted.
    tensorboard : bool
        Also write event files for TensorBoard.
    silent : bool
        Write nothing.
    """

    def __init__(self, run: RunFolder, epoch: int, tensorboard: bool, silent: bool) -> None:
        self._run = None if silent else run
        self._events = None
        if silent:
            return
        run.keep_metric_lines(epoch)
        if tensorboard:
            from torch.utils.tensorboard import SummaryWriter

            self._events = SummaryWriter(run.tensorboard, purge_step=epoch + 1)

    def write(self, line: Line) -> None:
        """Append the measures of an epoch."""
        if self._run is not None:
            append_line(self._run.metrics, line)
        if self._events is not None:
            for name, value in line.items():
                if name != "epoch":
                    self._events.add_scalar(name, value, line["epoch"])
            self._events.flush()

    def close(self) -> None:
        """Close the files."""
        if self._events is not None:
            self._events.close()


def require_tensorboard() -> None:
    """Raise InputError unless the package tensorboard is installed."""
    if importlib.util.find_spec("tensorboard") is None:
        raise InputError(
            "tensorboard: not installed, expected the package 'tensorboard'", "tensorboard"
        )


def remark_on_start(trainer: Trainer, description: RunDescription, epoch: int) -> str | None:
    """Say what the learning rate does if the training goes on, or starts from other weights.

    Parameters
    ----------
    trainer : Trainer
    description : RunDescription
    epoch : int
        Number of finished epochs.
    """
    if epoch and description.went_on_from and epoch == description.went_on_from[-1]:
        return going_on(trainer.config, epoch, trainer.steps_per_epoch)
    if not epoch and description.start_from is not None:
        return beginning_anew(trainer.config, description.start_from.run)
    return None


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


def epoch_note(epoch: int, measures: Mapping[str, float], units: Units = SI) -> str:
    """Describe an epoch for the progress line.

    Parameters
    ----------
    epoch : int
    measures : mapping of str to float
        Its line of measures.
    units : Units
        Labels of the units of the errors.
    """
    note = f"epoch {epoch}, loss {measures['train_loss']:.3g}"
    if "validation_error" not in measures:
        return note
    error, relative = measures["validation_error"], measures["validation_relative_error"]
    size = f"{error:.2e} {units.length} ({relative:.2%} of the largest displacement)"
    return f"{note}, validation error {size}"


def advice(trainer: Trainer, measures: Mapping[str, float], units: Units = SI) -> str | None:
    """Say if the grid is too coarse, or the training samples are too few.

    The grid comes first: more samples do not change its part of the error.

    Parameters
    ----------
    trainer : Trainer
        Trainer of a training that is over.
    measures : mapping of str to float
        Measures of the last epoch.
    units : Units
        Labels of the units of the errors.
    """
    if "validation_error" not in measures:
        return None
    size, m = float(trainer.network.displacement_rms), units.length
    error, of_grid = measures["validation_error"], measures.get("grid_error", 0.0)
    if error > size:
        return (
            f"not trained: the error on validation samples, {error:.2e} {m}, is above "
            f"that of no displacement at all (root mean square {size:.2e} {m}); more epochs or a "
            "smaller learning rate would help"
        )
    if of_grid > LARGE_PART * error:
        return (
            f"the error on validation samples is {error:.2e} {m}, and {of_grid:.2e} {m} without "
            "an error at the grid's points; a finer grid would help (`datagen structure --error`, "
            "or `--grid`)"
        )
    on_training = trainer.training_error()
    if not error > OVERFITTED * on_training:
        return None
    return (
        f"the error on validation samples is {error:.2e} {m}, on training samples "
        f"{on_training:.2e} {m}; more than {len(trainer.train)} training samples would help "
        "(`datagen run CASE --samples K` or `surrogate sample BODY --count K` lets a dataset grow)"
    )
