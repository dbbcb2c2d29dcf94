"""What a training would take: some of its steps are timed, and nothing is written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.command_line import laid_out
from shared_schema.common.errors import InputError
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.networks.field_network import parameter_count
from surrogate.learning.runs.config_reader import Config, Data, read_config
from surrogate.learning.training.setup import (
    dataset_for,
    least_memory,
    make_trainer,
    split_for,
)
from surrogate.runtime.device import choose_device, hardware

SECONDS = 10.0  # of steps
MOST = 50  # steps
WARM_UP = 3  # steps that are not counted: libraries and optimisers allocate what they need


@dataclass(frozen=True)
class DryRun:
    """Size and duration of a training, from some of its steps.

    Attributes
    ----------
    architecture : str
    parameters : int
        Number of trainable parameters.
    memory : int
        Bytes of weights, gradients and states of the optimiser, and of a batch, from below.
    samples, validation : int
        Number of samples that the weights are fitted to, mirror images included, and of validation
        samples.
    epochs, steps : int
        Number of epochs, and of all their steps.
    seconds : float
        Mean time of a step in s.
    timed : int
        Number of steps that were timed.
    hardware : str
    """

    architecture: str
    parameters: int
    memory: int
    samples: int
    validation: int
    epochs: int
    steps: int
    seconds: float
    timed: int
    hardware: str

    @property
    def minutes(self) -> float:
        """Time of all steps in min; validation and checkpoints are not counted."""
        return self.steps * self.seconds / 60

    def __str__(self) -> str:
        return laid_out(self.rows())

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield names and values for a table."""
        yield "network", f"{self.architecture}, {self.parameters / 1e6:.3g} M parameters"
        yield "samples", f"{self.samples} for training, {self.validation} for validation"
        yield "memory", f"{self.memory / 1e6:.3g} MB at least, besides the samples"
        yield "a step", f"{1e3 * self.seconds:.3g} ms, the mean of {self.timed}, on {self.hardware}"
        yield "the training", f"{self.epochs} epochs, {self.steps} steps: {self.minutes:.3g} min"


@checked_arguments
def dry_run(
    config: Config,
    dataset: Data,
    *,
    device: str = "auto",
) -> DryRun:
    """Build the network, and time some steps of its training; nothing is written.

    Parameters
    ----------
    config : Model, mapping, str or Path
        Configuration, as `surrogate.read_config` takes it.
    dataset : Dataset, str, Path or sequence of str or Path
        Dataset, its folder, or the folders of several that are joined.
    device : {"auto", "cpu", "cuda"}

    Raises
    ------
    InputError
        As `surrogate.train`; also for a model that is fitted directly, without steps.
    """
    config, target = read_config(config, data=dataset), choose_device(device)
    data = dataset_for(config, dataset)
    if not isinstance(config, TrainedModel):
        raise InputError(
            f"dry_run: config '{config.name}' is fitted directly, expected a model that is "
            "trained step by step",
            "dry_run",
        )
    trainer = make_trainer(config, data, split_for(config, data), target)
    times = list(trainer.timed_steps(WARM_UP + MOST, SECONDS))
    counted = times[WARM_UP:] or times[-1:]
    return DryRun(
        architecture=config.architecture,
        parameters=parameter_count(trainer.network),
        memory=least_memory(config, data, len(trainer.train)),
        samples=len(trainer.train),
        validation=len(trainer.validation),
        epochs=config.training.epochs,
        steps=trainer.steps,
        seconds=sum(counted) / len(counted),
        timed=len(counted),
        hardware=hardware(target),
    )
