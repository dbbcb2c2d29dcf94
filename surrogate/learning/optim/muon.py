r"""Muon: momentum whose update of every weight matrix is made orthogonal (Jordan et al. 2024).

A kernel of shape (outputs, inputs, 3, 3[, 3]) is an m × n matrix W with one row per output. With
its Nesterov momentum M, the update is

.. math:: W ← W - η · 0.2 \sqrt{\max(m, n)} · \operatorname{NS}(M),
   \qquad \operatorname{NS}(U Σ V^T) ≈ U V^T,

where NS denotes five Newton–Schulz iterations :math:`X ← aX + (bA + cA^2)X,\ A = XX^T`. With the
factor, the update has the same root mean square as an update of Adam (Liu et al. 2025,
arXiv 2502.16982). `torch.optim.Muon` is not used: it accepts only matrices, and it iterates in
bfloat16, which is slow on CPUs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor

COEFFICIENTS = (3.4445, -4.7750, 2.0315)
ITERATIONS = 5


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
