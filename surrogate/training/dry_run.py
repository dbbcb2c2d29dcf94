"""What a training would take: some of its steps are timed, and nothing is written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch

from shared_schema.common.errors import InputError
from surrogate.data.dataset import Dataset
from surrogate.hardware import hardware, require_device_memory
from surrogate.models.model import Model, TrainedModel
from surrogate.networks.unet import parameter_count
from surrogate.runs.split import split_training
from surrogate.training.memory_estimate import training_memory
from surrogate.training.train import first_samples, make_trainer, mirrored, require_samples_at

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

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield names and values for a table."""
        yield "network", f"{self.architecture}, {self.parameters / 1e6:.3g} M parameters"
        yield "samples", f"{self.samples} for training, {self.validation} for validation"
        yield "memory", f"{self.memory / 1e6:.3g} MB at least, besides the samples"
        yield "a step", f"{1e3 * self.seconds:.3g} ms, the mean of {self.timed}, on {self.hardware}"
        yield "the training", f"{self.epochs} epochs, {self.steps} steps: {self.minutes:.3g} min"


def dry_run(config: Model, dataset: Dataset, device: torch.device) -> DryRun:
    """Build the network, and time some steps of its training.

    Parameters
    ----------
    config : Model
    dataset : Dataset
    device : torch.device

    Raises
    ------
    InputError
        As `train`; also for a model that is fitted directly, without steps.
    """
    if not isinstance(config, TrainedModel):
        raise InputError(
            f"--dry-run: config '{config.name}' is fitted directly, expected a model that is "
            "trained step by step"
        )
    require_samples_at(config, dataset)
    split = split_training(dataset.training, config)
    config.require_suitable(dataset, split.train)
    split = replace(split, train=mirrored(split.train, config, dataset))
    batch = min(config.training.batch_size, len(split.train))
    memory = training_memory(config, dataset.geometry, batch)
    require_device_memory(memory, f"config '{config.name}': training", device)
    material = dataset.material if config.needs_material else None
    body = dataset.geometry, dataset.info, material
    network = config.build_for(*body, dataset.manifest.case)
    config.start_from_data(network, dataset, first_samples(split, config.seed))
    trainer = make_trainer(config, network, split, dataset, device)
    times = list(trainer.timed_steps(WARM_UP + MOST, SECONDS))
    counted = times[WARM_UP:] or times[-1:]
    return DryRun(
        architecture=config.architecture,
        parameters=parameter_count(network),
        memory=memory,
        samples=len(split.train),
        validation=len(split.validation),
        epochs=config.training.epochs,
        steps=trainer.steps,
        seconds=sum(counted) / len(counted),
        timed=len(counted),
        hardware=hardware(device),
    )
