"""Training: one loop for every network.

The dataset lives on the device as a whole. Every epoch's order is a pure function of the seed and
the epoch, and every step's learning rate one of the step, so that k + k epochs are 2k, bit for bit.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass

import torch
from torch import Tensor

from shared_schema.command_line import Progress
from shared_schema.errors import InputError, WorkError
from surrogate.checkpoint import load_checkpoint, save_checkpoint
from surrogate.dataset import Dataset, Samples
from surrogate.field_network import FieldNetwork
from surrogate.flipout import flipouts
from surrogate.likelihoods import Prediction, deterministic_loss, negative_log_likelihood
from surrogate.network import make_network
from surrogate.optimisation import make_optimisers, set_learning_rate
from surrogate.run_config import RunConfig
from surrogate.run_description import describe
from surrogate.run_folder import RunFolder
from surrogate.seeds import NOISE, ORDER, VALIDATION, stream
from surrogate.unet import parameter_count


def all_finite(network: torch.nn.Module) -> bool:
    """Tell whether no weight is NaN or infinite."""
    return all(bool(torch.isfinite(p).all()) for p in network.parameters())


def split_validation(samples: Samples, fraction: float, seed: int) -> tuple[Samples, Samples]:
    """Set a random part of the training split aside for validation."""
    generator = torch.Generator().manual_seed(stream(seed, VALIDATION))
    order = torch.randperm(len(samples), generator=generator)
    count = round(fraction * len(samples))
    return samples[order[count:].sort().values], samples[order[:count].sort().values]


@dataclass
class Trainer:
    """A network in training.

    Attributes
    ----------
    config : RunConfig
    network : FieldNetwork
        On the device of the samples.
    train, validation : Samples
    node_fraction : float
        Part of the grid points that are nodes.
    """

    config: RunConfig
    network: FieldNetwork
    train: Samples
    validation: Samples
    node_fraction: float

    def __post_init__(self) -> None:
        training = self.config.training
        self.optimisers = make_optimisers(self.network, training.optimiser)
        self.steps_per_epoch = math.ceil(len(self.train) / training.batch_size)
        self.steps = self.steps_per_epoch * training.epochs
        self.flipouts = list(flipouts(self.network))

    def loss(self, prediction: Prediction, reference: Tensor) -> Tensor:
        """Loss per datum of a prediction, in scaled units; without the weights' divergence."""
        training, network = self.config.training, self.network
        if prediction.std is None:
            return deterministic_loss(training.loss, prediction.mean, reference, network.unit)
        return negative_log_likelihood(
            prediction, reference, network.free_points, network.unit, training.beta
        )

    def divergence(self) -> Tensor:
        """Divergence of the posterior from the prior, per datum of the training samples, in nats.

        With it, N·F times the loss per datum is the paper's (Eq. ELBO_expand): the sum of the
        negative log-likelihood over all N samples and F free components, plus the divergence.
        """
        data = len(self.train) * self.network.free_points.numel() * self.train.force.shape[1]
        return torch.stack([layer.divergence() for layer in self.flipouts]).sum() / data

    def order(self, epoch: int) -> Tensor:
        """Order in which an epoch takes the training samples."""
        generator = torch.Generator().manual_seed(stream(self.config.seed, ORDER, epoch))
        return torch.randperm(len(self.train), generator=generator).to(self.train.force.device)

    def train_epoch(self, epoch: int, progress: Progress) -> float:
        """Train one epoch (counted from 0); return its mean loss."""
        training, variational = self.config.training, self.config.variational
        self.network.train()
        torch.manual_seed(stream(self.config.seed, NOISE, epoch))
        total = torch.zeros((), device=self.train.force.device)
        for number, batch in enumerate(torch.split(self.order(epoch), training.batch_size)):
            step = epoch * self.steps_per_epoch + number
            factor = training.schedule.factor(step, self.steps)
            set_learning_rate(self.optimisers, training.optimiser.learning_rate * factor)
            samples = self.train[batch]
            loss = self.loss(self.network(samples.force), samples.displacement)
            if variational is not None:
                loss = loss + variational.factor(step, self.steps) * self.divergence()
            self.network.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            if training.optimiser.gradient_clip is not None:
                torch.nn.utils.clip_grad_norm_(
                    self.network.parameters(), training.optimiser.gradient_clip
                )
            for optimiser in self.optimisers:
                optimiser.step()
            total += loss.detach() * len(batch)
            progress.update(step + 1)
        return float(total) / len(self.train)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss and mean absolute error (in m, over the nodes) on the validation part."""
        if len(self.validation) == 0:
            return {}
        self.network.eval()
        prediction, reference = self.network(self.validation.force), self.validation.displacement
        loss = self.loss(prediction, reference)
        error = (prediction.mean - reference).abs().mean() / self.node_fraction
        return {"validation_loss": float(loss), "validation_error": float(error)}


def train(
    config: RunConfig,
    dataset: Dataset,
    run: RunFolder,
    device: torch.device,
    stop_after: int | None = None,
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

    Raises
    ------
    InputError
        If the dataset is of another case, or the folder of another run.
    WorkError
        If the loss is no longer finite; the last good checkpoint is kept.
    """
    if stop_after is not None and stop_after < 1:
        raise InputError(f"--stop-after {stop_after}: expected an epoch, 1 at least")
    description = describe(config, dataset)
    train_part, validation_part = split_validation(
        dataset.train, config.training.validation_fraction, config.seed
    )
    if len(train_part) == 0:
        raise InputError(
            f"config '{config.name}': key 'training.validation_fraction' = "
            f"{config.training.validation_fraction} leaves none of {len(dataset.train)} samples"
        )
    run.start(description)
    if run.model.is_file():
        return
    epochs = config.training.epochs
    network = make_network(description, dataset.geometry).to(device)
    if dataset.geometry.dimension == 2:
        network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    node_fraction = float(dataset.geometry.grid.mask.mean())
    trainer = Trainer(
        config, network, train_part.to(device), validation_part.to(device), node_fraction
    )
    if config.displacement_scale == "node":
        network.scale_by_node(trainer.train.displacement)
    start, seconds = 0, 0.0
    if run.checkpoint.is_file():
        start, seconds = load_checkpoint(run.checkpoint, network, trainer.optimisers)
    run.keep_metric_lines(start)

    progress = Progress(
        trainer.steps,
        start * trainer.steps_per_epoch,
        "steps",
        f"surrogate train {config.name} ({parameter_count(network) / 1e6:.2f} M parameters)",
    )
    saved = time.perf_counter()
    last = epochs if stop_after is None else min(stop_after, epochs)
    for epoch in range(start, last):
        began = time.perf_counter()
        loss = trainer.train_epoch(epoch, progress)
        if not (math.isfinite(loss) and all_finite(network)):
            kept = (
                f"the checkpoint of epoch {start}" if run.checkpoint.is_file() else "no checkpoint"
            )
            raise WorkError(f"diverged in epoch {epoch + 1}, with a loss of {loss}; {kept} is kept")
        measures = trainer.validate()
        seconds += time.perf_counter() - began
        line = {"epoch": epoch + 1, "train_loss": loss, **measures, "seconds": seconds}
        with run.metrics.open("a") as file:
            file.write(json.dumps(line) + "\n")
        if epoch + 1 == last or time.perf_counter() - saved > config.training.checkpoint_seconds:
            save_checkpoint(run.checkpoint, epoch + 1, seconds, network, trainer.optimisers)
            start, saved = epoch + 1, time.perf_counter()
    progress.close(f"{seconds:.0f} s")
    if last == epochs:
        run.write_tensors({**network.cpu().state_dict(), **dataset.geometry.tensors()})
