r"""What a network's output means, and the loss that follows from it.

Deterministic (Deshpande et al. 2022, Eq. lossDeterm): the mean squared error

.. math:: L = \frac{1}{N} \sum_i \| U(f_i) - u_i \|_2^2,

which is divided here by the number of components and the square of the displacement scale, so
that losses of different cases compare; the minimiser is the same.
"""

from __future__ import annotations

from typing import Literal

from torch import Tensor

Likelihood = Literal["deterministic"]


def output_channels(likelihood: Likelihood, dimension: int) -> int:
    """Number of output channels: one a displacement component."""
    return dimension


def mean_squared_error(predicted: Tensor, reference: Tensor, scale: Tensor) -> Tensor:
    """Mean over samples and components of ((U − u) / scale)²."""
    return ((predicted - reference) / scale).square().mean()
