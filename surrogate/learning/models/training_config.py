"""Keys of ``training`` in a configuration: each kind of model has only the keys that it reads."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Literal, Self

from pydantic import Field, StrictBool, model_validator
from torch import Tensor

from shared_schema.common.configuration import Frozen
from surrogate.learning.data.samples import Location
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.optim.optimisers import (
    EarlyStoppingConfig,
    OptimiserConfig,
    ScheduleConfig,
)
from surrogate.learning.probabilistic.likelihoods import (
    Errors,
    Loss,
    Prediction,
    deterministic_loss,
    negative_log_likelihood,
)
from surrogate.runtime.device import Precision


class SplitConfig(Frozen):
    """Number of training samples, and fractions of them that are kept out of training or fitting.

    Attributes
    ----------
    samples : int, optional
        Number of samples that are used, the first of the training split; all by default. The scales
        of forces and displacements are those of the whole split.
    validation_fraction : float
        Fraction for the loss curve, for `early_stopping` and for `recalibrate`.
    calibration_fraction : float
        Fraction for conformal intervals only.
    """

    samples: int | None = Field(None, ge=1)
    validation_fraction: float = Field(0.0, ge=0, lt=1)
    calibration_fraction: float = Field(0.0, ge=0, lt=1)

    @property
    def validation_users(self) -> tuple[str, ...]:
        """Names of the keys in use that need validation samples."""
        return ()


class TrainingConfig(SplitConfig, ABC):
    """Settings of a training (defaults: the paper's recipe in two dimensions).

    Attributes
    ----------
    mirrors : tuple of {"x", "y", "z"}
        Axes about whose normal planes the body is symmetric, which is checked; the mirror images of
        the training samples are then training samples too.
    epochs : int
        Number of times that the training goes through all samples.
    batch_size : int
        Number of samples of a step.
    optimiser : OptimiserConfig
        Optimiser and its learning rate.
    schedule : ScheduleConfig
        Learning rate over the steps of the training.
    early_stopping : EarlyStoppingConfig, optional
        Early stopping; the model is then that of the epoch with the smallest validation loss.
    ema : float, optional
        Decay of the exponential moving average of the weights; that average is then validated and
        becomes the model.
    precision : {"float32", "tensorfloat32", "bfloat16"}
        Precision of the convolutions; weights, losses and validation are always in float32.
        ``tensorfloat32`` rounds the factors of products on a GPU to 11 significant bits; on a CPU
        it is float32.
    compile : bool
        Compile the network by `torch.compile`.
    cuda_graphs : bool
        Launch a whole step as one CUDA graph; useful for small batches on a GPU.
    samples_on : {"auto", "device", "host", "disk"}
        Memory that holds the samples; ``auto`` chooses the device's if they fit. With ``disk`` the
        samples are read from their shards in every epoch, in an order that is random within a
        window (`surrogate.learning.data.samples_on_disk`); the dataset may be larger than the
        memory.
    checkpoint_seconds : float
        Time in s between two checkpoints; one is always written at the end.
    """

    mirrors: tuple[Literal["x", "y", "z"], ...] = Field((), max_length=3)
    epochs: int = Field(600, gt=0, le=10**6)
    batch_size: int = Field(4, gt=0, le=10**6)
    optimiser: OptimiserConfig = OptimiserConfig()
    schedule: ScheduleConfig = ScheduleConfig()
    early_stopping: EarlyStoppingConfig | None = None
    ema: float | None = Field(None, gt=0, lt=1)
    precision: Precision = "float32"
    compile: bool = False
    cuda_graphs: bool = False
    samples_on: Location = "auto"
    checkpoint_seconds: float = Field(60.0, ge=0, le=10**7)

    @property
    def validation_users(self) -> tuple[str, ...]:
        """Names of the keys in use that need validation samples."""
        return ("early_stopping",) if self.early_stopping is not None else ()

    @property
    @abstractmethod
    def objective(self) -> str:
        """Name of the loss per datum."""

    @abstractmethod
    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the loss per datum (see `Model.data_loss`)."""

    @property
    def in_brief(self) -> str:
        """Optimiser, epochs and batches, such as "Muon, 80 epochs, batches of 32"."""
        name = self.optimiser.name.capitalize()
        return f"{name}, {self.epochs} epochs, batches of {self.batch_size}"

    @model_validator(mode="after")
    def _validation_samples_if_needed(self) -> Self:
        for key in self.validation_users:
            if self.validation_fraction == 0:
                raise ValueError(f"{key} expects validation_fraction > 0, found 0")
        return self


class RecalibratedTraining(TrainingConfig):
    """Training of a network that may predict standard deviations.

    Attributes
    ----------
    recalibrate : bool or float
        Fit factors on the predicted standard deviations to the validation samples; with a level,
        such as 0.95, so that intervals of this level hold that share of their values. The factors
        depend on the number of loaded nodes.
    """

    recalibrate: StrictBool | Annotated[float, Field(gt=0, lt=1)] = False

    @property
    def validation_users(self) -> tuple[str, ...]:
        """Names of the keys in use that need validation samples."""
        return (*super().validation_users, *(("recalibrate",) if self.recalibrate else ()))


class RegressionTraining(TrainingConfig):
    """Training of a network that predicts displacements without a likelihood.

    Attributes
    ----------
    loss : {"mse", "mae"}
        Mean squared error or mean absolute error.
    """

    loss: Loss = "mse"

    @property
    def objective(self) -> str:
        """Name of the loss per datum."""
        return {"mse": "mean squared error", "mae": "mean absolute error"}[self.loss]

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the mean squared or absolute error, with displacements in units of their RMS."""
        return deterministic_loss(self.loss, prediction.mean, reference, network.displacement_rms)


class DeterministicTraining(RegressionTraining, RecalibratedTraining):
    """Training of deterministic U-Nets, including ensembles and U-Nets with dropout."""


class LikelihoodTraining(RecalibratedTraining):
    """Training of a network that predicts a mean and a standard deviation of every component.

    Attributes
    ----------
    beta : float
        Exponent of the likelihood's weights (`negative_log_likelihood`); the paper's value is 0.
    errors : {"gaussian", "laplace"}
        Distribution of the errors in the likelihood; the paper's is the Gaussian. Laplace's is for
        errors with heavy tails.
    """

    beta: float = Field(0.0, ge=0, le=1)
    errors: Errors = "gaussian"

    @property
    def objective(self) -> str:
        """Name of the loss per datum."""
        return "negative log-likelihood"

    def data_loss(self, prediction: Prediction, reference: Tensor, network: FieldNetwork) -> Tensor:
        """Return the negative log-likelihood in nats, with displacements in units of their RMS."""
        unit = network.displacement_rms
        return negative_log_likelihood(
            prediction, reference, network.free_components, unit, self.beta, self.errors
        )
