r"""Meaning of a network's output for each likelihood, and the loss that follows from it.

==================  ===============================================================================
deterministic       :math:`\frac{1}{N} \sum_i \| U(f_i) - u_i \|_2^2` (Deshpande et al. 2022, Eq.
                    lossDeterm), or its 1-norm, the measure ē itself
maximum_likelihood  :math:`u ∼ N(d_μ(f), σ^2(f)),\ σ = \ln(1 + e^{d_ρ(f)})`: negative
                    log-likelihood (Eq. MLE_loss)
variational_bayes   the same with probabilistic weights: negative evidence lower bound (Eq. ELBO)
==================  ===============================================================================

Beyond the paper, the errors of the last two may have Laplace's distribution of standard deviation σ
in place of the Gaussian: its logarithm grows with the size of u − μ, as the mean absolute error
does, so that a few large errors do not outweigh all others.

Every loss is divided by the number of data (samples times components), and displacements are
divided by their root mean square, so that losses of different cases are comparable; the minimiser
is the same. The evidence lower bound is put together per datum (Eq. ELBO_expand),

.. math:: -\frac{ELBO}{N F} = \frac{1}{N F} \sum_{i=1}^{N} \sum_{j=1}^{F} -\ln p(u_{ij} | f_i, w)
   + κ \frac{1}{N F} \sum_{w} KL[q(w) | p(w)]

over all N training samples, their F free components, and *all* random weights w. The factor κ is 1
of the bound itself, and grows to its value in a warm-up (`VariationalConfig.factor`).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from surrogate.learning.probabilistic.flipout import VariationalConfig, flipouts
from surrogate.mechanics.body.geometry import at_components

Likelihood = Literal["deterministic", "maximum_likelihood", "variational_bayes"]
Loss = Literal["mse", "mae"]
Errors = Literal["gaussian", "laplace"]
INFORMATION: dict[Errors, tuple[float, float]] = {"gaussian": (1.0, 2.0), "laplace": (2.0, 1.0)}


"""Fisher information on μ/σ and on ln σ."""


class Prediction(NamedTuple):
    """Predicted displacements.

    Attributes
    ----------
    mean : Tensor, (N, d, nx, ny[, nz])
        Mean μ in m.
    std : Tensor of the same shape, or None
        Standard deviation σ of every component in m; None for a deterministic network.
    """

    mean: Tensor
    std: Tensor | None


def output_channels(likelihood: Likelihood, dimension: int) -> int:
    """Number of output channels: a mean and, unless deterministic, a ρ for every component."""
    return dimension if likelihood == "deterministic" else 2 * dimension


def deterministic_loss(loss: Loss, predicted: Tensor, reference: Tensor, unit: Tensor) -> Tensor:
    """Mean over samples and components of ((U − u) / unit)² or ``|U − u|`` / unit.

    Parameters
    ----------
    loss : {"mse", "mae"}
    predicted, reference : Tensor, (N, d, nx, ny[, nz])
        Displacements U and u in m.
    unit : Tensor, ()
        Unit of displacements in m.
    """
    error = (predicted - reference) / unit
    return error.square().mean() if loss == "mse" else error.abs().mean()


def negative_log_likelihood(
    prediction: Prediction,
    reference: Tensor,
    free: Tensor,
    unit: Tensor,
    beta: float = 0.0,
    errors: Errors = "gaussian",
) -> Tensor:
    r"""Mean over samples and free components of −ln p(u; μ, σ), in nats, with lengths in `unit`.

    .. math:: -\ln p = \frac{1}{2} \ln(2πσ^2) + \frac{(u - μ)^2}{2σ^2} \text{ (Gaussian)},
       \quad \ln(\sqrt{2} σ) + \sqrt{2} \frac{|u - μ|}{σ} \text{ (Laplace)}

    Parameters
    ----------
    prediction : Prediction
        Prediction with a standard deviation.
    reference : Tensor, (N, d, nx, ny[, nz])
        Displacement u in m.
    free : Tensor of int, (n_free,)
        Numbers of the components that are not held in a flattened field, (d · nx · ny[ · nz],).
    unit : Tensor, ()
        Unit of displacements in m.
    beta : float
        Every term is weighted by σ^{2β}, held constant and divided by its mean: 0 is the
        likelihood; towards 1 the means are fitted as by least squares (Seitzer et al. 2022).
    errors : {"gaussian", "laplace"}
        Distribution of u − μ.
    """
    assert prediction.std is not None
    mean = at_components(prediction.mean, free) / unit
    std = at_components(prediction.std, free) / unit
    u = at_components(reference, free) / unit
    z = (u - mean) / std
    if errors == "gaussian":
        nll = std.log() + 0.5 * z.square() + 0.5 * math.log(2 * math.pi)
    else:
        nll = std.log() + math.sqrt(2) * z.abs() + 0.5 * math.log(2)
    if beta:
        weight = std.detach() ** (2 * beta)
        nll = nll * (weight / weight.mean())
    return nll.mean()


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
