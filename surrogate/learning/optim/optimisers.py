"""Optimisers by name, one for each kind of parameter of a network."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from surrogate.learning.optim.muon import Muon
from surrogate.learning.optim.optimisation_keys import OptimiserConfig


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
