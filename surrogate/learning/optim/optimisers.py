r"""Optimisers by name, one for each kind of parameter of a network, and their configuration keys.

Muon is momentum whose update of every weight matrix is made orthogonal (Jordan et al. 2024). A
kernel of shape (outputs, inputs, 3, 3[, 3]) is an m × n matrix W with one row per output. With
its Nesterov momentum M, the update is

.. math:: W ← W - η · 0.2 \sqrt{\max(m, n)} · \operatorname{NS}(M),
   \qquad \operatorname{NS}(U Σ V^T) ≈ U V^T,

where NS denotes five Newton–Schulz iterations :math:`X ← aX + (bA + cA^2)X,\ A = XX^T`. With the
factor, the update has the same root mean square as an update of Adam (Liu et al. 2025,
arXiv 2502.16982). `torch.optim.Muon` is not used: it accepts only matrices, and it iterates in
bfloat16, which is slow on CPUs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any, Literal, Self

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from shared_schema.common.configuration import Frozen

ONE_CYCLE_START = 1 / 25  # default of torch's OneCycleLR
MOMENTUM = 0.95
Decay = Annotated[float, Field(ge=0, lt=1)]
COEFFICIENTS = (3.4445, -4.7750, 2.0315)
ITERATIONS = 5


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


class Muon(torch.optim.Optimizer):
    """Muon for convolution kernels and matrices.

    Parameters
    ----------
    parameters : iterable of Tensor
        Tensors of at least two dimensions, outputs first.
    lr : float or Tensor, ()
        Learning rate η.
    momentum : float
    weight_decay : float
        Decoupled weight decay, as in AdamW.
    """

    def __init__(
        self,
        parameters: Iterable[Tensor],
        lr: float | Tensor,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
    ) -> None:
        defaults = {"lr": lr, "momentum": momentum, "weight_decay": weight_decay}
        super().__init__(parameters, defaults)

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """Update every parameter that has a gradient."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    self._update(parameter, group)
        return loss

    def _update(self, parameter: Any, group: dict[str, Any]) -> None:
        gradient, state = parameter.grad, self.state[parameter]
        if not state:
            state["momentum"] = torch.zeros_like(parameter)
        momentum: Tensor = state["momentum"]
        momentum.lerp_(gradient, 1 - group["momentum"])
        nesterov = gradient.lerp(momentum, group["momentum"])
        matrix = nesterov.flatten(1)
        direction = orthogonalise(matrix).view_as(nesterov)
        rate = group["lr"]
        parameter.mul_(1 - rate * group["weight_decay"])
        factor = -rate * 0.2 * max(matrix.shape) ** 0.5
        if isinstance(factor, Tensor):
            parameter.addcmul_(direction, factor)
        else:
            parameter.add_(direction, alpha=factor)


def orthogonalise(matrix: Tensor) -> Tensor:
    """Bring all singular values of a matrix near 1 by Newton–Schulz iterations.

    The iterations act on the small square matrix A = XXᵀ; X is multiplied once, at the end.
    """
    a, b, c = COEFFICIENTS
    if matrix.shape[0] > matrix.shape[1]:
        return orthogonalise(matrix.mT).mT
    x = matrix / (matrix.norm() + 1e-12)
    gram = x @ x.mT
    total: Tensor | None = None
    for iteration in range(ITERATIONS):
        factor = torch.addmm(gram, gram, gram, beta=b, alpha=c)
        factor.diagonal().add_(a)
        total = factor if total is None else factor @ total
        if iteration < ITERATIONS - 1:
            gram = factor @ gram @ factor
    assert total is not None
    return torch.mm(total, x)


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
