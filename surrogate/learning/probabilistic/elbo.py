r"""The evidence lower bound, put together per datum (Deshpande et al. 2022, Eq. ELBO_expand).

.. math:: -\frac{ELBO}{N F} = \frac{1}{N F} \sum_{i=1}^{N} \sum_{j=1}^{F} -\ln p(u_{ij} | f_i, w)
   + κ \frac{1}{N F} \sum_{w} KL[q(w) | p(w)]

over all N training samples, their F free components, and *all* random weights w. The factor κ is 1
of the bound itself, and grows to its value in a warm-up (`VariationalConfig.factor`).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from surrogate.learning.probabilistic.flipout import VariationalConfig, flipouts


class EvidenceLowerBound:
    """The bound of a network in training.

    Parameters
    ----------
    network : nn.Module
        Network with Flipout convolutions.
    config : VariationalConfig
    data : int
        N · F, times the number of members of an ensemble: the bound is then the mean of theirs.
    device : torch.device

    Attributes
    ----------
    factor : Tensor, ()
        κ at the current step.
    """

    def __init__(
        self, network: nn.Module, config: VariationalConfig, data: int, device: torch.device
    ) -> None:
        self.layers = list(flipouts(network))
        self.config, self.data = config, data
        self.factor = torch.zeros((), device=device)

    def set_step(self, step: int, steps: int) -> None:
        """Set κ for a step (0 … steps − 1)."""
        self.factor.fill_(self.config.factor(step, steps))

    def kl_divergence(self) -> Tensor:
        """KL divergence per datum, summed over all random weights, in nats."""
        total = torch.stack([layer.kl_divergence() for layer in self.layers]).sum()
        return total / self.data

    def negative(self, negative_log_likelihood: Tensor, kl_divergence: Tensor) -> Tensor:
        """Put the negative bound together from its two terms, both per datum, in nats."""
        return negative_log_likelihood + self.factor * kl_divergence
