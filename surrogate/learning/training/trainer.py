"""A network in training: its steps, its epochs, and the final model.

The order of the samples and the noise of an epoch depend only on seed and epoch; the learning rate
of a step depends only on its number.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice

import torch
from torch import Tensor, nn

from shared_schema.common.progress import Progress
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.models.training_config import LikelihoodTraining
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.networks.unet import normalised_biases
from surrogate.learning.optim.final_weights import EarlyStopping, WeightAverage
from surrogate.learning.optim.gauss_newton import EVERY, GaussNewtonStd
from surrogate.learning.optim.optimisers import make_optimisers, set_learning_rate
from surrogate.learning.probabilistic.likelihoods import EvidenceLowerBound
from surrogate.learning.training.checkpoint import Stateful
from surrogate.learning.training.cuda_graph import CapturedStep, can_capture, compiled
from surrogate.learning.training.data_parallel import ALONE, Ranks
from surrogate.learning.training.sample_store import SampleStore, prepared_store
from surrogate.learning.training.validation import Reference, loss_per_datum, validate
from surrogate.runtime.device import NOISE, ORDER, autocast, convolutions, stream

TERMS = ("train_loss", "negative_log_likelihood", "kl_divergence")


@dataclass
class Trainer:
    """A network in training.

    Attributes
    ----------
    config : TrainedModel
    network : FieldNetwork
        Network, already on the device of the training.
    train, validation : Samples or SamplesOnDisk
    ranks : Ranks
        Processes that train the network together.
    note : str
        Remark of the progress line: loss and validation error of the last epoch.
    compared, compared_train : Reference, optional
        What errors of the validation samples, and of as many training samples, are compared with;
        by default the samples themselves, on a grid of nodes.
    """

    config: TrainedModel
    network: FieldNetwork
    train: Samples | SamplesOnDisk
    validation: Samples | SamplesOnDisk
    ranks: Ranks = ALONE
    compared: Reference | None = None
    compared_train: Reference | None = None

    def __post_init__(self) -> None:
        training, self.device = self.config.training, self.network.displacement_rms.device
        self.steps_per_epoch = math.ceil(len(self.train) / training.batch_size)
        self.steps = self.steps_per_epoch * training.epochs
        posterior, self.elbo, self.posterior_std = self.config.posterior, None, None
        if posterior is not None:
            components = self.network.free_components.numel()
            data = len(self.train) * components * self.network.members
            self.elbo = EvidenceLowerBound(self.network, posterior, data, self.device)
            if posterior.posterior_std == "gauss_newton":
                assert isinstance(training, LikelihoodTraining)
                self.posterior_std = GaussNewtonStd(self.network, len(self.train), training.errors)
        self.train_store = self._stored(self.train)
        self.validation_store = self._stored(self.validation)
        self.note = ""
        captures = training.cuda_graphs and can_capture(self.device, self.ranks.count)
        for bias in normalised_biases(self.network):
            bias.requires_grad_(False)
        self.optimisers = make_optimisers(self.network, training.optimiser, captures)
        learned = self.network.learned
        self.forward = compiled(learned) if training.compile else learned
        self.captured_step = self._captured(self.step) if captures else None
        self.captured_estimate = self._captured(self.estimate) if captures else None
        self._rate = math.nan
        self.average = WeightAverage(self.network, training.ema) if training.ema else None
        self.stopping = EarlyStopping(training.early_stopping) if training.early_stopping else None

    def _stored(self, samples: Samples | SamplesOnDisk) -> SampleStore:
        """Put samples where the configuration wants them, as the network learns from them."""
        location = self.config.training.samples_on
        return prepared_store(samples, self.network, location, self.device)

    def _captured(self, work: Callable[..., Tensor]) -> CapturedStep:
        """Capture the work on a full batch as a CUDA graph."""
        return CapturedStep(partial(work, whole=self.config.training.batch_size))

    @property
    def model(self) -> FieldNetwork:
        """Network that is validated and becomes the model: the trained one, or the average."""
        return self.network if self.average is None else self.average.module

    def order(self, epoch: int) -> Tensor:
        """Return the order of the training samples in an epoch."""
        generator = torch.Generator().manual_seed(stream(self.config.seed, ORDER, epoch))
        return self.train.order(generator).to(self.train_store.home)

    def differentiate(self, samples: Samples, whole: int) -> Tensor:
        """Set the gradients of this process's share of a batch of `whole` samples.

        Returns
        -------
        Tensor, (1,) or (3,)
            This process's share of the loss and, for variational networks, of the two terms of the
            loss (`TERMS`). The sum of the shares over all processes is the value of the batch.
        """
        self.network.zero_grad(set_to_none=True)
        if len(samples) == 0:
            return torch.zeros(1 if self.elbo is None else 3, device=self.device)
        with autocast(self.config.training.precision, self.device):
            prediction = self.forward(samples.force)
        data_loss = loss_per_datum(self.config, self.network, prediction, samples)
        terms = [data_loss * (len(samples) / whole)]
        if self.elbo is not None:
            kl_divergence = self.elbo.kl_divergence() / min(whole, self.ranks.count)
            terms = [self.elbo.negative(terms[0], kl_divergence), *terms, kl_divergence]
        terms[0].backward()  # type: ignore[no-untyped-call]
        return torch.stack(terms).detach()

    def step(self, samples: Samples, whole: int) -> Tensor:
        """Update the weights by one batch; return the result of `differentiate`."""
        with convolutions(self.config.training.precision):
            terms = self.differentiate(samples, whole)
        self.ranks.add_up_gradients(self.network)
        optimiser = self.config.training.optimiser
        if optimiser.gradient_clip is not None:
            torch.nn.utils.clip_grad_norm_(self.network.parameters(), optimiser.gradient_clip)
        for each in self.optimisers:
            each.step()
        return terms

    def estimate(self, samples: Samples, whole: int) -> Tensor:
        """Estimate the Fisher information of the weights from one batch."""
        assert self.posterior_std is not None
        with convolutions(self.config.training.precision):
            return self.posterior_std.estimate(samples.force, whole)

    def train_epoch(self, epoch: int, progress: Progress) -> dict[str, float]:
        """Train one epoch (counted from 0); return its mean losses and last learning rate."""
        total = torch.zeros((), device=self.device)
        for step, samples, whole in self._batches(epoch):
            total = total + self._take(step, samples, whole) * whole
            progress.update(step + 1, self.note)
        self.ranks.add_up(total)
        means = [value / len(self.train) for value in total.tolist()]
        rate = self.learning_rate((epoch + 1) * self.steps_per_epoch - 1)
        return {**dict(zip(TERMS, means, strict=False)), "learning_rate": rate}

    def _batches(self, epoch: int) -> Iterator[tuple[int, Samples, int]]:
        """Yield number of the step, share of its batch, and size of the batch, for an epoch."""
        config, training = self.config, self.config.training
        self.network.train()
        others = (self.ranks.rank,) if self.ranks.rank else ()
        torch.manual_seed(stream(config.seed, NOISE, epoch, *others))
        batches = torch.split(self.order(epoch), training.batch_size)
        shares = self.train_store.batches(self.ranks.share(batch) for batch in batches)
        for number, (batch, samples) in enumerate(zip(batches, shares, strict=True)):
            yield epoch * self.steps_per_epoch + number, samples, len(batch)

    def learning_rate(self, step: int) -> float:
        """Return the learning rate of a step."""
        training = self.config.training
        return training.optimiser.learning_rate * training.schedule.factor(step, self.steps)

    def _take(self, step: int, samples: Samples, whole: int) -> Tensor:
        """Take a step of the training; return the result of `differentiate`."""
        rate = self.learning_rate(step)
        if rate != self._rate:
            set_learning_rate(self.optimisers, rate)
            self._rate = rate
        if self.elbo is not None:
            self.elbo.set_step(step, self.steps)
        is_full = whole == self.config.training.batch_size
        captured = self.captured_step if is_full else None
        terms = self.step(samples, whole) if captured is None else captured(samples)
        if self.posterior_std is not None and step % EVERY == 0:
            captured = self.captured_estimate if is_full else None
            estimate = self.estimate(samples, whole) if captured is None else captured(samples)
            assert self.config.posterior is not None
            factor = self.config.posterior.factor(step, self.steps)
            self.ranks.add_up(estimate)
            self.posterior_std.update(estimate, factor)
        if self.average is not None:
            self.average.update(self.network)
        return terms

    def timed_steps(self, most: int, seconds: float) -> Iterator[float]:
        """Take the first steps and yield the time of each, until they are `most` or took long."""
        began = last = time.perf_counter()
        for step, samples, whole in islice(self._batches(0), most):
            self._take(step, samples, whole)
            if self.device.type == "cuda":
                torch.cuda.synchronize(self.device)
            now = time.perf_counter()
            yield now - last
            last = time.perf_counter()
            if last - began > seconds:
                break

    def validate(self) -> dict[str, float]:
        """Return loss and errors on the validation samples."""
        if self.compared is None:
            self.compared = Reference.on_grid(self.validation)
        count = len(self.validation)
        return validate(self.config, self.model, self.validation_store, count, self.compared)

    def training_error(self) -> float:
        """Return the mean absolute error in m on as many training samples as for validation."""
        count = min(len(self.validation), len(self.train))
        compared = self.compared_train or Reference.on_grid(self.train[:count])
        measures = validate(self.config, self.model, self.train_store, count, compared)
        return measures["validation_error"]

    def finish_epoch(self, epoch: int, measures: Mapping[str, float]) -> None:
        """Pass the measures of an epoch (counted from 1) to early stopping.

        The loss decides; on an embedded grid the error at the nodes, of which the loss on the grid
        is only a part.
        """
        if self.stopping is not None:
            of_nodes = "grid_error" in measures
            measured = measures["validation_error" if of_nodes else "validation_loss"]
            self.stopping.observe(epoch, measured, self.model)

    def is_over(self, epoch: int) -> bool:
        """Return True if the training is over after an epoch (counted from 1)."""
        stopped = self.stopping is not None and self.stopping.is_over(epoch)
        return stopped or epoch >= self.config.training.epochs

    def states(self) -> dict[str, Stateful]:
        """Return all objects that a checkpoint holds, except the optimisers, by name."""
        states: dict[str, Stateful] = {"network": self.network}
        if self.posterior_std is not None:
            states["posterior_std"] = self.posterior_std
        if self.average is not None:
            states["average"] = self.average.module
        if self.stopping is not None:
            states["early_stopping"] = self.stopping
        return states

    def resume_after(self, epochs: int) -> None:
        """Set the counters for a training that resumes after some epochs."""
        if self.average is not None:
            self.average.steps = epochs * self.steps_per_epoch

    def result(self) -> Mapping[str, Tensor]:
        """Return the state of the final model."""
        return self.stopping.best if self.stopping is not None else self.model.state_dict()


def all_finite(network: nn.Module) -> bool:
    """Return True if no weight is NaN or infinite."""
    return bool(torch.stack([torch.isfinite(p).all() for p in network.parameters()]).all())
