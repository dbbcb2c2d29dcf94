r"""Standard deviations of Gaussian posteriors that maximise the bound of a linearised network.

If the network is linearised in its weights, the evidence lower bound has its maximum at

.. math:: \frac{1}{σ_w^2} = \frac{1}{σ_p^2} + \frac{h_w}{κ}, \qquad
   h_w = \sum_{i=1}^{N} \sum_{j=1}^{F} \frac{1}{σ_{ij}^2} \Big(\frac{∂μ_{ij}}{∂w}\Big)^2
       + 2 \Big(\frac{∂ \ln σ_{ij}}{∂w}\Big)^2

Here h is the diagonal of the Fisher information of the N·F data, averaged over weights drawn from
the posterior (generalised Gauss–Newton; Khan et al. 2018), and κ is the factor on the KL
divergence. For errors of Laplace's distribution the factors 1 and 2 change places. In theory,
stochastic gradients of ρ lead to the same σ; in practice, their noise is much larger than their
mean. The sum over a batch is estimated, with a relative standard deviation of √2, by the square of
the gradient of the following function with random signs v and v':

.. math:: \sum_{ij} v_{ij} \frac{μ_{ij}}{\bar σ_{ij}}
   + \sqrt{2} v'_{ij} \frac{σ_{ij}}{\bar σ_{ij}}, \qquad \bar σ = σ \text{ held constant.}
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.probabilistic.flipout import random_signs
from surrogate.learning.probabilistic.gaussian_parameter import GaussianParameter
from surrogate.learning.probabilistic.likelihoods import INFORMATION, Errors
from surrogate.mechanics.body.geometry import at_components

EVERY = 4  # number of steps between two estimates
MEMORY = 200  # number of estimates in the exponential average


class GaussNewtonStd:
    """Setter of the weights' standard deviations in training, from an average of estimates of h.

    Parameters
    ----------
    network : FieldNetwork
        Network with random weights; gradients no longer train its ρ.
    samples : int
        Number of training samples N.
    errors : {"gaussian", "laplace"}
        Their distribution in the likelihood.
    """

    def __init__(self, network: FieldNetwork, samples: int, errors: Errors = "gaussian") -> None:
        self.network, self.samples, self.errors = network, samples, errors
        self.parameters = [m for m in network.modules() if isinstance(m, GaussianParameter)]
        for parameter in self.parameters:
            parameter.rho.requires_grad_(False)
        self.sizes = [parameter.mean.numel() for parameter in self.parameters]
        self.information = torch.zeros(sum(self.sizes), device=network.displacement_rms.device)
        self.weight = torch.zeros(())

    def estimate(self, inputs: Tensor, whole: int) -> Tensor:
        """Estimate h from a batch; the sum over all processes is the estimate.

        Parameters
        ----------
        inputs : Tensor, (n, inputs, nx, ny[, nz])
            Inputs of `FieldNetwork.learned`, of this process's share of the batch.
        whole : int
            Number of samples in the whole batch.

        Returns
        -------
        Tensor, (n_weights,)
        """
        return self._squared_gradients(inputs) * (self.samples / whole)

    def update(self, estimate: Tensor, factor: float) -> None:
        """Add the estimate of a batch to the average, and set every σ.

        Parameters
        ----------
        estimate : Tensor, (n_weights,)
            Sum of the estimates of all processes.
        factor : float
            Factor κ on the KL divergence.
        """
        self.information.lerp_(estimate, 1 / MEMORY)
        self.weight.lerp_(torch.ones(()), 1 / MEMORY)
        if factor > 0:
            informations = torch.split(self.information / (self.weight.item() * factor), self.sizes)
            for parameter, h in zip(self.parameters, informations, strict=True):
                std = (h.view_as(parameter.mean) + parameter.prior_std**-2).rsqrt()
                parameter.set_std(std)

    def _squared_gradients(self, inputs: Tensor) -> Tensor:
        """Estimate the sum h over some samples, (n_weights,)."""
        if len(inputs) == 0:
            return torch.zeros_like(self.information)
        prediction = self.network.learned(inputs)
        assert prediction.std is not None
        free = self.network.free_components
        mean, std = at_components(prediction.mean, free), at_components(prediction.std, free)
        signs, other = random_signs(mean, mean.shape), random_signs(mean, mean.shape)
        of_mean, of_std = INFORMATION[self.errors]
        values = math.sqrt(of_mean) * signs * mean + math.sqrt(of_std) * other * std
        total = (values / std.detach()).sum()
        means = [parameter.mean for parameter in self.parameters]
        gradients = torch.autograd.grad(total, means)
        return torch.cat([gradient.flatten() for gradient in gradients]).square()

    def state_dict(self) -> Mapping[str, Tensor]:
        """Return the average as tensors for the checkpoint."""
        return {"information": self.information, "weight": self.weight}

    def load_state_dict(self, state_dict: Mapping[str, Tensor], /) -> None:
        """Restore the average from the tensors of `state_dict`."""
        self.information.copy_(state_dict["information"])
        self.weight.copy_(state_dict["weight"])
