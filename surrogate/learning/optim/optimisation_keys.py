"""Configuration keys of a training: optimiser, learning-rate schedule, early stopping."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from shared_schema.common.configuration import Frozen

ONE_CYCLE_START = 1 / 25  # default of torch's OneCycleLR
MOMENTUM = 0.95
Decay = Annotated[float, Field(ge=0, lt=1)]


class OptimiserConfig(Frozen):
    """Optimiser and learning rate (defaults: the paper's).

    Attributes
    ----------
    name : {"adam", "muon"}
        Optimiser. ``muon`` updates the kernels and matrices between hidden layers by Muon and all
        other parameters by Adam.
    learning_rate : float
        Peak learning rate.
    betas : tuple of 2 floats
        Decay rates of Adam's moments.
    momentum : float
        Momentum of Muon.
    weight_decay : float
        Decoupled weight decay.
    rho_factor : float
        Factor on the learning rate of the ρ of Gaussian posteriors. The best ρ follow the σ of the
        likelihood, which falls by orders of magnitude in training; if ρ lags behind, predicted
        standard deviations are too large.
    gradient_clip : float or None
        Largest allowed 2-norm of the gradient of all parameters; None for no limit.
    """

    name: Literal["adam", "muon"] = "adam"
    learning_rate: float = Field(1e-4, gt=0, le=10)
    betas: tuple[Decay, Decay] = (0.9, 0.999)
    momentum: float = Field(MOMENTUM, ge=0, lt=1)
    weight_decay: float = Field(0.0, ge=0, le=100)
    rho_factor: float = Field(1.0, gt=0, le=1e6)
    gradient_clip: float | None = Field(None, gt=0, le=1e6)

    @model_validator(mode="after")
    def _momentum_is_of_muon(self) -> Self:
        if self.name == "adam" and self.momentum != MOMENTUM:
            raise ValueError(f"momentum = {self.momentum}: expected with name 'muon' only")
        return self


class ScheduleConfig(Frozen):
    """Learning rate during the training, as a factor on its peak.

    Attributes
    ----------
    name : {"constant", "linear", "cosine", "one_cycle"}
        Learning rate after the warm-up: constant at the peak, or a linear or cosine decay to
        `final`. ``one_cycle`` is a half cosine up and a half cosine down, as in torch's OneCycleLR
        (Smith and Topin 2018).
    warmup : float
        Fraction of all steps in which the rate grows: linearly from zero or, with ``one_cycle``, as
        a half cosine from 1/25 of the peak.
    final : float
        Factor at the end of a decay.
    """

    name: Literal["constant", "linear", "cosine", "one_cycle"] = "constant"
    warmup: float = Field(0.0, ge=0, lt=1)
    final: float = Field(0.0, ge=0, le=1)

    @model_validator(mode="after")
    def _final_is_of_a_decay(self) -> Self:
        if self.name == "constant" and self.final != 0:
            raise ValueError(f"final = {self.final}: expected none with name 'constant'")
        return self

    def factor(self, step: int, steps: int) -> float:
        """Return the factor on the learning rate at a step (0 … steps − 1).

        It depends only on `step`, `steps` and the configuration.
        """
        if self.name == "one_cycle":
            return self._one_cycle(step, steps)
        done = (step + 1) / steps
        if done < self.warmup:
            return done / self.warmup
        if self.name == "constant":
            return 1.0
        left = (1.0 - step / steps) / (1.0 - self.warmup) if self.warmup < 1 else 0.0
        left = min(1.0, left)
        decay = left if self.name == "linear" else 0.5 * (1 - math.cos(math.pi * left))
        return self.final + (1 - self.final) * decay

    def _one_cycle(self, step: int, steps: int) -> float:
        peak = self.warmup * steps - 1
        if step < peak:
            return cosine_between(ONE_CYCLE_START, 1.0, step / peak)
        peak = max(peak, 0.0)
        return cosine_between(1.0, self.final, (step - peak) / max(steps - 1 - peak, 1.0))


class EarlyStoppingConfig(Frozen):
    """Condition for stopping a training before its last epoch.

    Attributes
    ----------
    patience : int
        Number of consecutive epochs without a new smallest validation loss, after which the
        training stops.
    """

    patience: int = Field(gt=0, le=10**6)


def cosine_between(start: float, end: float, done: float) -> float:
    """Interpolate from start (done = 0) to end (done = 1) by a half cosine."""
    return end + (start - end) * 0.5 * (1 + math.cos(math.pi * done))
