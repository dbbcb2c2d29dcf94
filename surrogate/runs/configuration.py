"""The configuration of a training run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from shared_schema.common.configuration import Frozen, read_named, validate
from surrogate.baselines.pod import PODConfig
from surrogate.data.sample_store import Residency
from surrogate.device import Precision
from surrogate.networks.unet import UNetConfig
from surrogate.optim.early_stopping import EarlyStoppingConfig
from surrogate.optim.optimisers import OptimiserConfig, ScheduleConfig
from surrogate.probabilistic.flipout import VariationalConfig
from surrogate.probabilistic.likelihoods import Likelihood, Loss

SHIPPED = Path(__file__).parents[1] / "configs"


class TrainingConfig(Frozen):
    """How a network is trained (defaults: the paper's recipe in two dimensions).

    Attributes
    ----------
    epochs : int
    batch_size : int
    optimiser : OptimiserConfig
    schedule : ScheduleConfig
    loss : {"mse", "mae"}
        Of deterministic networks: mean squared error, or mean absolute error.
    beta : float
        Of the others: exponent of the likelihood's weights (`negative_log_likelihood`); 0 is the
        paper's.
    validation_fraction : float
        Part of the training split that is kept out of training, for the loss curve, for
        `early_stopping` and for `recalibrate`.
    recalibrate : bool
        Whether predicted standard deviations get factors fitted to that part.
    calibration_fraction : float
        Part of the training split that nothing sees but conformal intervals.
    early_stopping : EarlyStoppingConfig, optional
        With it the model is that of the epoch with the smallest validation loss.
    ema : float, optional
        Decay of the exponential moving average of the weights; with it that average is what is
        validated and becomes the model.
    precision : {"float32", "bfloat16"}
        Of the convolutions; weights, losses and validation are in float32 in any case.
    compile : bool
        Whether the network is compiled by `torch.compile`.
    cuda_graphs : bool
        Whether a whole step is launched as one CUDA graph: for small batches on a GPU.
    residency : {"auto", "device", "host"}
        Where the samples live; ``auto``: on the device, if they fit.
    checkpoint_seconds : float
        Time between two checkpoints; one is written at the end in any case.
    """

    epochs: int = Field(600, gt=0)
    batch_size: int = Field(4, gt=0)
    optimiser: OptimiserConfig = OptimiserConfig()
    schedule: ScheduleConfig = ScheduleConfig()
    loss: Loss = "mse"
    beta: float = Field(0.0, ge=0, le=1)
    validation_fraction: float = Field(0.0, ge=0, lt=1)
    recalibrate: bool = False
    calibration_fraction: float = Field(0.0, ge=0, lt=1)
    early_stopping: EarlyStoppingConfig | None = None
    ema: float | None = Field(None, gt=0, lt=1)
    precision: Precision = "float32"
    compile: bool = False
    cuda_graphs: bool = False
    residency: Residency = "auto"
    checkpoint_seconds: float = Field(60.0, ge=0)

    @model_validator(mode="after")
    def _validation_part_if_needed(self) -> Self:
        for key, is_given in (
            ("early_stopping", self.early_stopping is not None),
            ("recalibrate", self.recalibrate),
        ):
            if is_given and self.validation_fraction == 0:
                raise ValueError(f"{key} expects validation_fraction > 0, found 0")
        return self


class RunConfig(Frozen):
    """Everything that determines a training run, the data apart.

    Attributes
    ----------
    name : str
    case : str
        Name of the case whose dataset it is for.
    recipe : {"paper", "fast", "custom"}
        Whose recipe it is.
    model : {"unet", "linear", "pod"}
        The paper's U-Net, or what it is compared with: one linear layer that starts at K⁻¹, or
        proper orthogonal decomposition and regression, which is fitted rather than trained.
    likelihood : {"deterministic", "maximum_likelihood", "variational_bayes"}
    network : UNetConfig
        Of the U-Net.
    pod : PODConfig, optional
        Of the model of that name, and of it only.
    ensemble : int
        Number of U-Nets, trained together from different initial weights.
    variational : VariationalConfig, optional
        Of variational Bayes, and of it only: which weights are probabilistic, and their priors.
    displacement_scale : {"global", "node"}
        Scale of the network's output: one for all, or one for each component of each node.
    training : TrainingConfig
    seed : int
        Of the initial weights, the validation part, the order of the samples and the noise.
    """

    name: str
    case: str
    recipe: Literal["paper", "fast", "custom"] = "custom"
    model: Literal["unet", "linear", "pod"] = "unet"
    likelihood: Likelihood = "deterministic"
    network: UNetConfig = UNetConfig()
    pod: PODConfig | None = None
    ensemble: int = Field(1, ge=1)
    variational: VariationalConfig | None = None
    displacement_scale: Literal["global", "node"] = "global"
    training: TrainingConfig = TrainingConfig()
    seed: int = Field(0, ge=0)

    @model_validator(mode="after")
    def _variational_if_bayes(self) -> Self:
        if (self.variational is not None) != (self.likelihood == "variational_bayes"):
            given = "given" if self.variational is not None else "missing"
            raise ValueError(f"'variational' is {given}, but 'likelihood' is '{self.likelihood}'")
        return self

    @model_validator(mode="after")
    def _keys_of_the_model(self) -> Self:
        if (self.pod is not None) != (self.model == "pod"):
            given = "given" if self.pod is not None else "missing"
            raise ValueError(f"'pod' is {given}, but 'model' is '{self.model}'")
        if self.model == "unet":
            return self
        for key, is_given in (
            ("network", self.network != UNetConfig()),
            ("ensemble", self.ensemble != 1),
        ):
            if is_given:
                raise ValueError(f"'{key}' is given, but 'model' is '{self.model}'")
        is_gaussian = self.pod is not None and self.pod.regression == "gp"
        expected = "maximum_likelihood" if is_gaussian else "deterministic"
        if self.likelihood != expected:
            kind = f"'{self.model}'" + (f" by '{self.pod.regression}'" if self.pod else "")
            raise ValueError(
                f"'likelihood' is '{self.likelihood}', expected '{expected}' of model {kind}"
            )
        return self

    @model_validator(mode="after")
    def _variational_levels_of_the_network(self) -> Self:
        levels = self.variational.levels if self.variational else None
        if not set(levels or ()) <= set(range(self.network.levels)):
            raise ValueError(
                f"'variational.levels' = {list(levels or ())}, expected levels of the network, "
                f"0 to {self.network.levels - 1}"
            )
        return self

    def plain(self) -> dict[str, Any]:
        """The whole configuration as plain data."""
        return self.model_dump(mode="json")


def read_config(name: str) -> RunConfig:
    """Read a configuration from a YAML file, or by the name of a shipped one.

    Raises
    ------
    InputError
        If there is none, or a key or value in it is wrong.
    """
    content, source = read_named(name, SHIPPED, "config")
    return validate(RunConfig, content, source)
