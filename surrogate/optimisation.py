"""Optimisers and learning-rate schedules, by name."""

from __future__ import annotations

import math
from typing import Literal

import torch
from pydantic import Field
from torch import nn

from shared_schema.configuration import Frozen
from surrogate.muon import Muon


class OptimiserConfig(Frozen):
    """Optimiser and learning rate (defaults: the paper's).

    Attributes
    ----------
    name : {"adam", "muon"}
        ``muon`` updates the convolution kernels between hidden layers by Muon, the rest by Adam.
    learning_rate : float
        Peak learning rate.
    betas : tuple of 2 floats
        Adam's.
    momentum : float
        Muon's.
    weight_decay : float
        Decoupled.
    gradient_clip : float or None
        Largest 2-norm of the gradient of all parameters.
    """

    name: Literal["adam", "muon"] = "adam"
    learning_rate: float = Field(1e-4, gt=0)
    betas: tuple[float, float] = (0.9, 0.999)
    momentum: float = Field(0.95, ge=0, lt=1)
    weight_decay: float = Field(0.0, ge=0)
    gradient_clip: float | None = Field(None, gt=0)


class ScheduleConfig(Frozen):
    """Learning rate over the training, as a factor on its peak.

    Attributes
    ----------
    name : {"constant", "linear", "cosine"}
        What follows the warm-up: the peak, or a decay to `final`.
    warmup : float
        Part of all steps over which the rate grows linearly from zero.
    final : float
        Factor at the end.
    """

    name: Literal["constant", "linear", "cosine"] = "constant"
    warmup: float = Field(0.0, ge=0, lt=1)
    final: float = Field(0.0, ge=0, le=1)

    def factor(self, step: int, steps: int) -> float:
        """Factor on the learning rate at a step (0 … steps − 1): a pure function of both."""
        done = (step + 1) / steps
        if done < self.warmup:
            return done / self.warmup
        if self.name == "constant":
            return 1.0
        left = (1.0 - step / steps) / (1.0 - self.warmup) if self.warmup < 1 else 0.0
        left = min(1.0, left)
        decay = left if self.name == "linear" else 0.5 * (1 - math.cos(math.pi * left))
        return self.final + (1 - self.final) * decay


def make_optimisers(network: nn.Module, config: OptimiserConfig) -> list[torch.optim.Optimizer]:
    """Make the optimisers of a network: one for each kind of parameter."""
    parameters = [p for p in network.parameters() if p.requires_grad]
    kernels = (
        [p for name, p in network.named_parameters() if is_hidden_kernel(name, p)]
        if config.name == "muon"
        else []
    )
    of_muon = {id(p) for p in kernels}
    rest = [p for p in parameters if id(p) not in of_muon]
    optimisers: list[torch.optim.Optimizer] = []
    if kernels:
        optimisers.append(Muon(kernels, config.learning_rate, config.momentum, config.weight_decay))
    if rest:
        optimisers.append(
            torch.optim.AdamW(
                rest,
                config.learning_rate,
                betas=config.betas,
                weight_decay=config.weight_decay,
                fused=True,
            )
        )
    return optimisers


def is_hidden_kernel(name: str, parameter: nn.Parameter) -> bool:
    """Tell kernels between hidden layers, or their means, from all other parameters."""
    is_kernel = name.endswith(("weight", "kernel.mean")) and not name.endswith("head.weight")
    return is_kernel and parameter.ndim > 2 and parameter.shape[1] > 3


def set_learning_rate(optimisers: list[torch.optim.Optimizer], learning_rate: float) -> None:
    """Set the learning rate of every group of every optimiser."""
    for optimiser in optimisers:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate
