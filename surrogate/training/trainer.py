"""A network in training: its steps, its epochs, and what it comes to.

Every epoch's order and noise are pure functions of the seed and the epoch, and every step's
learning rate one of the step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor, nn

from shared_schema.common.command_line import Progress
from surrogate.data.dataset import Samples
from surrogate.data.sample_store import store_samples
from surrogate.device import autocast
from surrogate.networks.field_network import FieldNetwork
from surrogate.optim.early_stopping import EarlyStopping
from surrogate.optim.optimisers import make_optimisers, set_learning_rate
from surrogate.optim.weight_average import WeightAverage
from surrogate.probabilistic.flipout import flipouts
from surrogate.probabilistic.likelihoods import (
    Prediction,
    deterministic_loss,
    negative_log_likelihood,
)
from surrogate.runs.configuration import RunConfig
from surrogate.seeds import NOISE, ORDER, stream
from surrogate.training.checkpoint import Stateful
from surrogate.training.compilation import compiled
from surrogate.training.cuda_graph import CapturedStep, can_capture
from surrogate.training.data_parallel import ALONE, Ranks
from surrogate.training.gauss_newton import EVERY, GaussNewtonSpreads

TERMS = ("train_loss", "negative_log_likelihood", "divergence")
VALIDATION_BATCH = 256


@dataclass
class Trainer:
    """A network in training.

    Attributes
    ----------
    config : RunConfig
    network : FieldNetwork
        On the device to train on.
    train, validation : Samples
    node_fraction : float
        Part of the grid points that are nodes.
    ranks : Ranks
        The processes that train it together.
    """

    config: RunConfig
    network: FieldNetwork
    train: Samples
    validation: Samples
    node_fraction: float
    ranks: Ranks = ALONE

    def __post_init__(self) -> None:
        training, self.device = self.config.training, self.network.unit.device
        self.steps_per_epoch = math.ceil(len(self.train) / training.batch_size)
        self.steps = self.steps_per_epoch * training.epochs
        self.flipouts = list(flipouts(self.network))
        self.divergence_factor = torch.zeros((), device=self.device)
        variational = self.config.variational
        self.spreads = (
            GaussNewtonSpreads(self.network, len(self.train))
            if variational is not None and variational.spread == "gauss_newton"
            else None
        )
        self.train_store, self.validation_store = (
            store_samples(samples, training.residency, self.device)
            for samples in (self.train, self.validation)
        )
        captures = training.cuda_graphs and can_capture(self.device, self.ranks.count)
        self.optimisers = make_optimisers(self.network, training.optimiser, captures)
        self.forward = compiled(self.network) if training.compile else self.network
        self.captured_step = (
            CapturedStep(partial(self.step, whole=training.batch_size)) if captures else None
        )
        self.average = WeightAverage(self.network, training.ema) if training.ema else None
        self.stopping = EarlyStopping(training.early_stopping) if training.early_stopping else None

    @property
    def model(self) -> nn.Module:
        """What is validated and becomes the model: the network, or the average of its weights."""
        return self.average.network if self.average else self.network

    def loss(self, prediction: Prediction, reference: Tensor) -> Tensor:
        """Loss per datum of a prediction, in scaled units; without the weights' divergence.

        Of an ensemble: the mean of its members' losses.
        """
        training, network = self.config.training, self.network
        if network.members > 1:
            reference = reference.repeat(network.members, *[1] * (reference.ndim - 1))
        if prediction.std is None:
            return deterministic_loss(training.loss, prediction.mean, reference, network.unit)
        return negative_log_likelihood(
            prediction, reference, network.free_points, network.unit, training.beta
        )

    def divergence(self) -> Tensor:
        """Divergence of the posterior from the prior, per datum of the training samples, in nats.

        With it, N·F times the loss per datum is the paper's (Eq. ELBO_expand): the sum of the
        negative log-likelihood over all N samples and F free components, plus the divergence.
        Of an ensemble: the mean of its members' divergences.
        """
        data = len(self.train) * self.network.free_points.numel() * self.train.force.shape[1]
        total = torch.stack([layer.divergence() for layer in self.flipouts]).sum()
        return total / (data * self.network.members)

    def order(self, epoch: int) -> Tensor:
        """Order in which an epoch takes the training samples."""
        generator = torch.Generator().manual_seed(stream(self.config.seed, ORDER, epoch))
        return torch.randperm(len(self.train), generator=generator).to(self.train_store.home)

    def differentiate(self, samples: Samples, whole: int) -> Tensor:
        """Set the gradients of this process's part of a batch of `whole` samples.

        Returns
        -------
        Tensor, (1,) or (3,)
            Its part of the loss and, of variational networks, of the loss's two terms (`TERMS`):
            those of all processes add up to the batch's.
        """
        self.network.zero_grad(set_to_none=True)
        variational = self.config.variational is not None
        if len(samples) == 0:
            return torch.zeros(3 if variational else 1, device=self.device)
        with autocast(self.config.training.precision, self.device):
            prediction = self.forward(samples.force)
        loss = self.loss(prediction, samples.displacement) * (len(samples) / whole)
        terms = [loss]
        if variational:
            divergence = self.divergence() / min(whole, self.ranks.count)
            loss = loss + self.divergence_factor * divergence
            terms = [loss, *terms, divergence]
        loss.backward()  # type: ignore[no-untyped-call]
        return torch.stack(terms).detach()

    def step(self, samples: Samples, whole: int) -> Tensor:
        """Update the weights by one batch; return what `differentiate` does."""
        terms = self.differentiate(samples, whole)
        self.ranks.add_up_gradients(self.network)
        optimiser = self.config.training.optimiser
        if optimiser.gradient_clip is not None:
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), optimiser.gradient_clip)
        for each in self.optimisers:
            each.step()
        return terms

    def train_epoch(self, epoch: int, progress: Progress) -> dict[str, float]:
        """Train one epoch (counted from 0); return its mean losses and last learning rate."""
        config, training = self.config, self.config.training
        self.network.train()
        others = (self.ranks.rank,) if self.ranks.rank else ()
        torch.manual_seed(stream(config.seed, NOISE, epoch, *others))
        batches = torch.split(self.order(epoch), training.batch_size)
        parts = self.train_store.batches(self.ranks.part(batch) for batch in batches)
        total, rate = torch.zeros((), device=self.device), 0.0
        for number, (batch, samples) in enumerate(zip(batches, parts, strict=True)):
            step = epoch * self.steps_per_epoch + number
            rate = training.optimiser.learning_rate * training.schedule.factor(step, self.steps)
            set_learning_rate(self.optimisers, rate)
            if config.variational is not None:
                self.divergence_factor.fill_(config.variational.factor(step, self.steps))
            if self.captured_step is not None and len(batch) == training.batch_size:
                terms = self.captured_step(samples)
            else:
                terms = self.step(samples, len(batch))
            if self.spreads is not None and step % EVERY == 0:
                factor = float(self.divergence_factor)
                self.spreads.update(samples.force, len(batch), factor, self.ranks)
            if self.average is not None:
                self.average.update(step)
            total = total + terms * len(batch)
            progress.update(step + 1)
        self.ranks.add_up(total)
        means = [value / len(self.train) for value in total.tolist()]
        return {**dict(zip(TERMS, means, strict=False)), "learning_rate": rate}

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss and mean absolute error (in m, over the nodes) on the validation part."""
        count = len(self.validation)
        if count == 0:
            return {}
        model, loss, error = self.model.eval(), 0.0, 0.0
        numbers = torch.arange(count, device=self.validation_store.home)
        for samples in self.validation_store.batches(torch.split(numbers, VALIDATION_BATCH)):
            prediction, weight = model(samples.force), len(samples) / count
            loss += weight * float(self.loss(prediction, samples.displacement))
            mean = prediction.mean.unflatten(0, (self.network.members, -1)).mean(dim=0)
            error += weight * float((mean - samples.displacement).abs().mean())
        return {"validation_loss": loss, "validation_error": error / self.node_fraction}

    def finish_epoch(self, epoch: int, measures: Mapping[str, float]) -> None:
        """Take note of the measures of an epoch (counted from 1)."""
        if self.stopping is not None:
            self.stopping.observe(epoch, measures["validation_loss"], self.model)

    def is_over(self, epoch: int) -> bool:
        """Tell whether the training is over after an epoch (counted from 1)."""
        stopped = self.stopping is not None and self.stopping.is_over(epoch)
        return stopped or epoch >= self.config.training.epochs

    def parts(self) -> dict[str, Stateful]:
        """What a checkpoint holds beside the states of the optimisers, by name."""
        parts: dict[str, Stateful] = {"network": self.network}
        if self.spreads is not None:
            parts["spreads"] = self.spreads
        if self.average is not None:
            parts["average"] = self.average.network
        if self.stopping is not None:
            parts["early_stopping"] = self.stopping
        return parts

    def result(self) -> Mapping[str, Tensor]:
        """State of the model that the training ends with."""
        return self.stopping.best if self.stopping is not None else self.model.state_dict()
