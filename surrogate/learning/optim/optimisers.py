"""Optimisers by name, one for each kind of parameter of a network."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from shared_schema.common.configuration import Frozen
from surrogate.learning.optim.muon import Muon

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


def make_optimisers(
    network: nn.Module, config: OptimiserConfig, capturable: bool = False
) -> list[torch.optim.Optimizer]:
    """Make the optimisers of a network: one for each kind of parameter.

    A network without some kind of parameter has fewer optimisers. If `capturable` is true (for CUDA
    graphs), the learning rate is a tensor on the device of the parameters.
    """
    kernels: list[nn.Parameter] = []
    rhos: list[nn.Parameter] = []
    rest: list[nn.Parameter] = []
    for name, parameter in network.named_parameters():
        if not parameter.requires_grad:
            continue
        if config.name == "muon" and is_hidden_kernel(name, parameter):
            kernels.append(parameter)
        else:
            (rhos if name.endswith("rho") else rest).append(parameter)
    optimisers: list[torch.optim.Optimizer] = []

    def rate(group: list[nn.Parameter]) -> float | Tensor:
        value = config.learning_rate
        return torch.tensor(value, device=group[0].device) if capturable else value

    if kernels:
        optimisers.append(Muon(kernels, rate(kernels), config.momentum, config.weight_decay))
    for group, decay, factor in (
        (rest, config.weight_decay, 1.0),
        (rhos, 0.0, config.rho_factor),
    ):
        if group:
            optimiser = torch.optim.AdamW(
                group,
                rate(group),
                betas=config.betas,
                weight_decay=decay,
                fused=True,
                capturable=capturable,
            )
            optimiser.param_groups[0]["factor"] = factor
            optimisers.append(optimiser)
    return optimisers


def is_hidden_kernel(name: str, parameter: nn.Parameter) -> bool:
    """Return True for a kernel between hidden layers, or for the mean of such a kernel."""
    is_kernel = name.endswith(("weight", "kernel.mean")) and not name.endswith("head.weight")
    if parameter.ndim == 2:
        return is_kernel and ".hidden." in name
    is_first = "encoder.0.0." in name
    return is_kernel and not is_first and parameter.ndim > 2 and parameter.shape[1] > 3


def set_learning_rate(optimisers: list[torch.optim.Optimizer], learning_rate: float) -> None:
    """Set the learning rate of every group of every optimiser, times the group's own factor."""
    for optimiser in optimisers:
        for group in optimiser.param_groups:
            rate = learning_rate * group.get("factor", 1.0)
            if isinstance(group["lr"], Tensor):
                group["lr"].fill_(rate)
            else:
                group["lr"] = rate
