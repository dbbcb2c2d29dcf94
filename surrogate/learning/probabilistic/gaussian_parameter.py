r"""A tensor of weights with a Gaussian posterior and a Gaussian prior for each of them.

.. math:: q(w) = N(μ, σ^2),\quad σ = \ln(1 + e^ρ), \qquad p(w) = N(μ_p, σ_p^2)

with trainable μ and ρ, constant σ_p, and μ_p trainable (empirical Bayes) or zero (Deshpande et al.
2022, Section 2.4).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor, nn
from torch.nn import functional


class GaussianParameter(nn.Module):
    """Posterior and prior of a tensor of weights.

    Parameters
    ----------
    mean : Tensor
        Initial μ of any shape; also the initial value of a trainable μ_p.
    std : float
        Initial σ of every weight.
    prior_std : float
        Prior standard deviation σ_p of every weight.
    trainable_prior : bool
        True if μ_p is trained; otherwise it is zero.

    Attributes
    ----------
    mean, rho : nn.Parameter
        Posterior mean μ, and ρ, which gives σ.
    prior_mean : nn.Parameter or Tensor
        Prior mean μ_p.
    """

    prior_mean: Tensor

    def __init__(self, mean: Tensor, std: float, prior_std: float, trainable_prior: bool) -> None:
        super().__init__()
        self.prior_std = prior_std
        self.mean = nn.Parameter(mean.detach().clone())
        self.rho = nn.Parameter(torch.full_like(mean, inverse_softplus(std)))
        if trainable_prior:
            self.prior_mean = nn.Parameter(mean.detach().clone())
        else:
            self.register_buffer("prior_mean", torch.zeros_like(mean))

    @property
    def std(self) -> Tensor:
        """Posterior standard deviation σ = ln(1 + e^ρ)."""
        return functional.softplus(self.rho)

    @torch.no_grad()
    def set_std(self, std: Tensor) -> None:
        """Set σ: ρ = ln(e^σ − 1)."""
        self.rho.copy_(std + torch.log(-torch.expm1(-std)))

    def kl_divergence(self) -> Tensor:
        r"""Kullback–Leibler divergence of posterior from prior, summed over the weights, in nats.

        .. math:: KL[q|p] = \sum \ln\frac{σ_p}{σ} + \frac{σ^2 + (μ - μ_p)^2}{2 σ_p^2} - \frac{1}{2}
        """
        ratio = self.std / self.prior_std
        offset = (self.mean - self.prior_mean) / self.prior_std
        return (0.5 * (ratio.square() + offset.square() - 1) - ratio.log()).sum()

    def sampled_kl_divergence(self, noise: Tensor) -> Tensor:
        r"""Sum of ln q(w) − ln p(w) over the weights, at w = μ + σε: the form of the paper's loss.

        Its expectation over the noise ε, of the weights' shape and standard normal, is
        `kl_divergence`.
        """
        ratio = self.std / self.prior_std
        offset = (self.mean - self.prior_mean) / self.prior_std + ratio * noise
        return (0.5 * (offset.square() - noise.square()) - ratio.log()).sum()

    def draw(self, generators: Sequence[torch.Generator]) -> Tensor:
        """Draw independent weights, one sample for each generator of the CPU, (passes, …)."""
        noise = torch.empty(len(generators), *self.mean.shape)

        def fill(sample: Tensor, generator: torch.Generator) -> None:
            sample.normal_(generator=generator)

        with ThreadPoolExecutor() as threads:  # numbers of one generator come from one thread
            deque(threads.map(fill, noise, generators), maxlen=0)
        return noise.to(self.mean).mul_(self.std).add_(self.mean)


def inverse_softplus(value: float) -> float:
    """Inverse of the softplus: ρ = ln(e^σ − 1) of a standard deviation σ."""
    return value + math.log(-math.expm1(-value))
